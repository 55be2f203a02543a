// SPDX-License-Identifier: Apache-2.0
// The length unit of a scene (method.md 4.4); the position learning rate is proportional to it.
#pragma once

#include <span>

#include "host/scene/dataset.hpp"

namespace ubs {

// 1.1 * the largest distance of a camera from the mean of the cameras; 0 for a single camera.
double scene_extent(std::span<const View> views);

// Whether all cameras have one position, but for rounding.
bool at_one_place(std::span<const Camera> cameras);

}  // namespace ubs
