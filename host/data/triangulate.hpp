// SPDX-License-Identifier: Apache-2.0
// Initial points from the pictures of a still scene: two that show the same corner tell where it is, and how
// far the pixels around it can be.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

struct Triangulation {
  PointCloud points;
  std::size_t corners = 0;  // the first of them; behind these, pixels between
};

// Corners (SIFT) of at most 200 views, evenly chosen, matched between neighbours along the lines that
// their cameras prescribe, and placed where the two rays meet; of several pairs the one with the widest angle
// counts. Then about `between` random pixels, fewer where little has texture: each takes the depth, among
// those of the corners around it, at which two neighbours show its surroundings best. Nothing where the
// pictures have no texture or the scene moves, and in a build without OpenCV. The same points at every call
// with `seed`.
Triangulation triangulate(std::span<const View> views, std::size_t between, std::uint64_t seed);

}  // namespace ubs
