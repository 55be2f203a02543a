// SPDX-License-Identifier: Apache-2.0
// Initial points where the data bring none: two pictures that show the same corner tell where it is.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

struct Triangulation {
  PointCloud points;
  // By view: column and row [px] of points in its picture, and their depth.
  std::vector<std::vector<std::array<double, 3>>> seen;
};

// Corners (SIFT) of at most `pictures` views, evenly chosen, matched between neighbours along the lines that
// their cameras prescribe, and placed where the two rays meet; of several pairs the one with the widest angle
// counts. About one in ten is wrong. Few or none where the pictures have no texture or the scene moves, and in a
// build without OpenCV. The same points at every call.
Triangulation triangulate(std::span<const View> views, std::size_t pictures = 200);

}  // namespace ubs
