// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/frame_rate.hpp"

#include <algorithm>

#include "host/base/statistics.hpp"
#include "host/base/stopwatch.hpp"

namespace ubs {

FrameRate frame_rate_of(const std::vector<double>& wall_ms, const std::vector<double>& device_ms) {
  FrameRate rate{.wall_fps = 1000 / summarise(wall_ms).median};
  if (const double device = summarise(device_ms).median; device > 0) rate.device_fps = 1000 / device;
  return rate;
}

FrameRate measure_frame_rate(Device& device, Renderer& renderer, std::span<const RenderGroup> groups,
                             const RenderSettings& settings, int views, int frames_per_view) {
  const int cameras = static_cast<int>(renderer.camera_count());
  views = std::min(views, cameras);
  if (views < 1 || frames_per_view < 1) return {.views = views, .frames_per_view = frames_per_view};
  const auto draw = [&](std::uint32_t camera) { renderer.forward(groups, camera, settings, false); };
  std::vector<double> wall_ms, device_ms;
  for (int i = 0; i < views; ++i) {
    const auto camera = static_cast<std::uint32_t>(i * cameras / views);
    draw(camera);
    device.finish();
    std::vector<double> frames;
    for (int k = 0; k < frames_per_view; ++k) {
      const Stopwatch watch;
      draw(camera);
      device.finish();
      frames.push_back(watch.milliseconds());
    }
    wall_ms.push_back(summarise(frames).median);
    device.set_profiling(true);
    for (int k = 0; k < frames_per_view; ++k) draw(camera);
    double total = 0;
    for (const TimerEntry& entry : device.timings()) total += entry.device_ms;
    device.set_profiling(false);
    device_ms.push_back(total / frames_per_view);
  }
  FrameRate rate = frame_rate_of(wall_ms, device_ms);
  rate.views = views;
  rate.frames_per_view = frames_per_view;
  return rate;
}

}  // namespace ubs
