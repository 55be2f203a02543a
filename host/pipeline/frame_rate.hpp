// SPDX-License-Identifier: Apache-2.0
// measure_frame_rate() measures how fast a model is rendered. Each frame runs the whole pipeline from raw
// parameters to the image, including the conditioning on the query.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "host/pipeline/renderer.hpp"

namespace ubs {

// FrameRate is the result of a measurement.
struct FrameRate {
  // Frames per second of wall time. A frame takes from the call until the image is finished on the device.
  double wall_fps = 0;
  // Frames per second according to the device's own timers of kernels and copies; empty if it has no timers.
  std::optional<double> device_fps;
  int views = 0, frames_per_view = 0;
};

// Computes the frame rates from the milliseconds per frame of each view. If the device has no timers,
// device_ms must contain zeros.
FrameRate frame_rate_of(const std::vector<double>& wall_ms, const std::vector<double>& device_ms);

// Measures `views` views that are spread evenly over the renderer's cameras. Each view is rendered once to
// warm up, then frames_per_view times for the wall time, with a wait after each frame, and then the same
// number of times with the device's own timers. Each view has one wall time per frame, which is the median of
// its frames, and one device time per frame, which is the mean of its frames. The results are computed from
// the medians of these times over all views.
FrameRate measure_frame_rate(Device& device, Renderer& renderer, std::span<const RenderGroup> groups,
                             const RenderSettings& settings, int views, int frames_per_view);

}  // namespace ubs
