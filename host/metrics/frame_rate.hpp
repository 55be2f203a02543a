// SPDX-License-Identifier: Apache-2.0
// How fast a model is drawn, conditioning on the query included: each frame runs the whole pipeline from raw
// parameters to the image.
#pragma once

#include <span>

#include "host/pipeline/renderer.hpp"

namespace ubs {

struct FrameRate {
  double wall_fps = 0;    // from the call to the finished image on the device
  double device_fps = 0;  // time in which the device worked on it (kernels and copies)
  int views = 0, frames_per_view = 0;
};

// Of `views` views evenly spread over the renderer's cameras. Each is drawn once to warm up, then
// frames_per_view times with the clock, each waited for, then as often with the device's own timers; a view
// counts with its median (wall) or mean (device), the result is the median over views.
FrameRate measure_frame_rate(Device& device, Renderer& renderer, std::span<const RenderGroup> groups,
                             const RenderSettings& settings, int views, int frames_per_view);

}  // namespace ubs
