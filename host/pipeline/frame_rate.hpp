// SPDX-License-Identifier: Apache-2.0
// How fast a model is drawn, conditioning on the query included: each frame runs the whole pipeline from raw
// parameters to the image.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "host/pipeline/renderer.hpp"

namespace ubs {

struct FrameRate {
  double wall_fps = 0;               // from the call to the finished image on the device
  std::optional<double> device_fps;  // by the device's own timers (kernels and copies), where it has them
  int views = 0, frames_per_view = 0;
};

// From milliseconds per frame of each view. Without timers of the device its times are 0.
FrameRate frame_rate_of(const std::vector<double>& wall_ms, const std::vector<double>& device_ms);

// Of `views` views evenly spread over the renderer's cameras. Each is drawn once to warm up, then
// frames_per_view times with the clock, each waited for, then as often with the device's own timers; a view
// counts with its median (wall) or mean (device), the result is the median over views.
FrameRate measure_frame_rate(Device& device, Renderer& renderer, std::span<const RenderGroup> groups,
                             const RenderSettings& settings, int views, int frames_per_view);

}  // namespace ubs
