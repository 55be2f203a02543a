// SPDX-License-Identifier: Apache-2.0
// PointCloud holds coloured points from which a model is initialised. The points come from structure from
// motion, from a file points3d.ply, or from ubs itself.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace ubs {

struct PointCloud {
  std::vector<std::array<float, 3>> positions;
  std::vector<std::array<std::uint8_t, 3>> colours;  // one per position
};

}  // namespace ubs
