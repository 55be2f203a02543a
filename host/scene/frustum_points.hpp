// SPDX-License-Identifier: Apache-2.0
// sample_frusta() creates random initial points in the region that the cameras see, between given depth
// bounds. Data in the layouts LLFF and N3V contain such bounds.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

// PointColours selects the colour of the points. With `pixels`, a point has the colour of the pixel at which
// it was placed, or is grey if the view has no image or the pixel is masked.
enum class PointColours { grey, pixels };

// Returns `count` points. Each point is placed at a random pixel of a view, at a random depth between the
// bounds of the view. The inverse depth is distributed uniformly. `bounds` contains the nearest and the
// farthest depth of each view.
PointCloud sample_frusta(std::span<const View> views, std::span<const std::array<double, 2>> bounds,
                         std::size_t count, std::uint64_t seed, PointColours colours = PointColours::grey);

}  // namespace ubs
