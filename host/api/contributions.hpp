// SPDX-License-Identifier: Apache-2.0
// What each splat of a model contributes to the pixels of a set of views.
#pragma once

#include <span>
#include <vector>

#include "host/pipeline/device_groups.hpp"

namespace ubs::reduce {

struct Contributions {
  std::size_t splats = 0, views = 0;
  // (views, splats): largest transmittance * alpha over the pixels of the view (stages.hpp, MeasureWeights).
  // 0: the image of the view is the same to the bit without the splat.
  std::vector<float> weights;
  std::vector<float> most;              // (splats) over the views
  std::vector<std::uint32_t> in_views;  // (splats) views with a weight above 0

  std::span<const float> view(std::size_t v) const { return {weights.data() + v * splats, splats}; }
};

// Draws views 0 .. views-1 of the renderer.
Contributions measure_contributions(Device& device, Renderer& renderer, const DeviceGroups& model,
                                    const RenderSettings& settings, std::size_t views);

}  // namespace ubs::reduce
