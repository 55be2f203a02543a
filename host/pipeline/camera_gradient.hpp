// SPDX-License-Identifier: Apache-2.0
// The gradient of a number with respect to the camera that it was drawn with.
#pragma once

#include <array>

#include "host/scene/camera.hpp"

namespace ubs {

struct CameraGradient {
  // Of moves in the camera's own frame: a turn w about its centre, R -> exp([w]) R and t -> exp([w]) t, and a
  // shift u, t -> t + u.
  std::array<double, 3> turn{}, shift{};
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double time = 0;
  std::array<double, 4> extra{};
};

// The same for the matrix (R | t), (3, 4) row-major, right for every change that leaves R a rotation: with dR
// = [a] R and dt the turn is w = a and the shift u = dt - a x t, so that v_t = v_u and v_a = v_w - t x v_u,
// which v_R = [v_a] R / 2 gives back as <v_R, [a] R> = v_a . a.
std::array<double, 12> matrix_gradient(const CameraGradient& gradient, const Camera& camera);

}  // namespace ubs
