// SPDX-License-Identifier: Apache-2.0
// A pinhole camera in COLMAP axes (x right, y down, z forward) and the query values of its frame.
#pragma once

#include <array>
#include <vector>

namespace ubs {

struct Camera {
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  // world -> camera, row-major
  std::array<double, 3> translation{0, 0, 0};                 // p_cam = rotation * p_world + translation
  double fx = 1, fy = 1;                                      // focal lengths [px]
  double cx = 0, cy = 0;  // principal point [px]; the centre of pixel (0,0) is (0.5, 0.5)
  int width = 0, height = 0;
  double time = 0;            // normalised over the training frames (method.md 4.6)
  std::vector<double> extra;  // further query values after time, for N > 7

  std::array<double, 3> centre() const;  // camera position in the world, -R^T t
};

}  // namespace ubs
