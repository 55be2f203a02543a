// SPDX-License-Identifier: Apache-2.0
// CameraGradient is the gradient of a scalar, such as the loss of an image, with respect to the camera of the
// image.
#pragma once

#include <array>

#include "host/scene/camera.hpp"

namespace ubs {

struct CameraGradient {
  // `turn` and `shift` are the gradients with respect to a small motion of the camera in its own frame.
  // `turn` belongs to a rotation w about the camera centre, which changes R to exp([w]) R and t to exp([w])
  // t. `shift` belongs to a translation u, which changes t to t + u.
  std::array<double, 3> turn{}, shift{};
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double time = 0;
  std::array<double, 4> extra{};
};

// Returns the gradient with respect to the matrix (R | t), as (3, 4) row-major values. It is valid for every
// change after which R is still a rotation. Such a change has the form dR = [a] R together with some dt. It
// consists of the rotation w = a and the translation u = dt - a x t. If v_x denotes the gradient with respect
// to x, this gives v_t = v_u and v_a = v_w - t x v_u. The result contains v_R = [v_a] R / 2, because then the
// scalar product of v_R and [a] R is v_a . a.
std::array<double, 12> matrix_gradient(const CameraGradient& gradient, const Camera& camera);

}  // namespace ubs
