// SPDX-License-Identifier: Apache-2.0
// Initial points in what the cameras see: between depth bounds (LLFF, N3V), or beside points that are known.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

enum class PointColours { grey, pixels };  // pixels: of the picture that the point was drawn in

// Points at random pixels of the views, uniform in inverse depth between near and far: equally dense in every
// image. One pair of bounds per view.
PointCloud sample_frusta(std::span<const View> views, std::span<const std::array<double, 2>> bounds,
                         std::size_t count, std::uint64_t seed, PointColours colours = PointColours::grey);

// Points at random pixels of the views, of their colours, at the depth of the nearest pixel of `seen`
// (column, row, depth), of which there is a list for each view. Views whose list is empty, or without an
// image, are left out.
PointCloud sample_near(std::span<const View> views, std::span<const std::vector<std::array<double, 3>>> seen,
                       std::size_t count, std::uint64_t seed);

}  // namespace ubs
