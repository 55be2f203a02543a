// SPDX-License-Identifier: Apache-2.0
// PointTree is a k-d tree of positions, for searches of nearest neighbours.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <nanoflann.hpp>
#include <span>

namespace ubs {

using Positions = std::span<const std::array<float, 3>>;

struct TreePoints {
  Positions positions;
  std::size_t kdtree_get_point_count() const { return positions.size(); }
  double kdtree_get_pt(std::size_t i, std::size_t axis) const { return positions[i][axis]; }
  template <typename Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};
using PointTree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, TreePoints>,
                                                      TreePoints, 3, std::uint32_t>;

}  // namespace ubs
