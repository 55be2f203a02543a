// SPDX-License-Identifier: Apache-2.0
// sample_frusta() creates random initial points in the region that the cameras see, between depth bounds
// (LLFF, N3V).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

enum class PointColours { grey, pixels };  // pixels: colour of the pixel through which the point was placed

// Returns points at random pixels of the views, uniform in inverse depth between near and far, so that they
// are equally dense in every image. There must be one pair of bounds per view.
PointCloud sample_frusta(std::span<const View> views, std::span<const std::array<double, 2>> bounds,
                         std::size_t count, std::uint64_t seed, PointColours colours = PointColours::grey);

}  // namespace ubs
