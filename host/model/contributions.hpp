// SPDX-License-Identifier: Apache-2.0
// Contributions states how much each splat of a model contributes to the pixels of a set of views.
#pragma once

#include <span>
#include <vector>

#include "host/pipeline/device_groups.hpp"

namespace ubs::reduce {

struct Contributions {
  std::size_t splats = 0, views = 0;
  // (views, splats): maximum of transmittance * alpha of the splat over the pixels of the view
  // (MeasureWeights in host/device/stages.hpp). If it is 0, the image of the view is bit-identical without
  // the splat.
  std::vector<float> weights;
  std::vector<float> most;              // (splats) maximum over the views
  std::vector<std::uint32_t> in_views;  // (splats) number of views with a weight above 0

  std::span<const float> view(std::size_t v) const { return {weights.data() + v * splats, splats}; }
};

// Renders the model for the cameras 0 to `views` - 1 of the renderer, and returns the contributions of its
// splats.
Contributions measure_contributions(Device& device, Renderer& renderer, const DeviceGroups& model,
                                    const RenderSettings& settings, std::size_t views);

}  // namespace ubs::reduce
