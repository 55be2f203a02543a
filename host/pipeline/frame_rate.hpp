// SPDX-License-Identifier: Apache-2.0
// measure_frame_rate() measures how fast a model is rendered. Each frame runs the whole pipeline from raw
// parameters to the image, including the conditioning on the query.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "host/pipeline/renderer.hpp"

namespace ubs {

struct FrameRate {
  double wall_fps = 0;               // from the call to the finished image on the device
  std::optional<double> device_fps;  // from the device's own timers (kernels and copies), if it has them
  int views = 0, frames_per_view = 0;
};

// Computes the frame rates from the milliseconds per frame of each view. If the device has no timers,
// device_ms must contain zeros.
FrameRate frame_rate_of(const std::vector<double>& wall_ms, const std::vector<double>& device_ms);

// Measures `views` views that are spread evenly over the renderer's cameras. Each view is rendered once to
// warm up, then frames_per_view times for the wall time, with a wait after each frame, and then as often with
// the device's own timers. The value of a view is the median of its wall times, and the mean of its device
// times. The result is the median over the views.
FrameRate measure_frame_rate(Device& device, Renderer& renderer, std::span<const RenderGroup> groups,
                             const RenderSettings& settings, int views, int frames_per_view);

}  // namespace ubs
