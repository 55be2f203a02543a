// SPDX-License-Identifier: Apache-2.0
// Coloured points, from structure-from-motion or a points3d.ply, that a model is initialised from.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace ubs {

struct PointCloud {
  std::vector<std::array<float, 3>> positions;
  std::vector<std::array<std::uint8_t, 3>> colours;  // as many as positions
};

}  // namespace ubs
