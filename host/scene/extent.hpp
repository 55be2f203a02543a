// SPDX-License-Identifier: Apache-2.0
// scene_extent() computes the extent of a scene from its cameras (method.md 4.4). The learning rate of
// positions is proportional to it.
#pragma once

#include <span>

#include "host/scene/dataset.hpp"

namespace ubs {

// Returns 1.1 times the largest distance of a camera from the mean position of the cameras. This is 0 for a
// single camera.
double scene_extent(std::span<const View> views);

// Returns the largest distance of a camera from the first one.
double position_spread(std::span<const Camera> cameras);

// Returns whether all cameras have the same position, apart from rounding. The distance of each camera from
// the first must be at most 1e-7 times the largest distance of a camera from the origin.
bool at_one_place(std::span<const Camera> cameras);

}  // namespace ubs
