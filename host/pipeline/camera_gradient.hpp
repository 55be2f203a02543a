// SPDX-License-Identifier: Apache-2.0
// CameraGradient is the gradient of a scalar, such as the loss of an image, with respect to the camera of the
// image.
#pragma once

#include <array>

#include "host/scene/camera.hpp"

namespace ubs {

struct CameraGradient {
  // The gradient with respect to motions in the camera's own frame: a rotation w about its centre, R ->
  // exp([w]) R and t -> exp([w]) t, and a shift u, t -> t + u.
  std::array<double, 3> turn{}, shift{};
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double time = 0;
  std::array<double, 4> extra{};
};

// Returns the gradient with respect to the matrix (R | t), (3, 4) row-major. It is valid for every change
// that leaves R a rotation. For dR = [a] R and dt, the rotation is w = a and the shift is u = dt - a x t, so
// v_t = v_u and v_a = v_w - t x v_u. The result has v_R = [v_a] R / 2, because then <v_R, [a] R> = v_a . a.
std::array<double, 12> matrix_gradient(const CameraGradient& gradient, const Camera& camera);

}  // namespace ubs
