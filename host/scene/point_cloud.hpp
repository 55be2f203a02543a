// SPDX-License-Identifier: Apache-2.0
// PointCloud holds coloured points that a model is initialised from. They come from structure from motion or
// from a points3d.ply.
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
