// SPDX-License-Identifier: Apache-2.0
// See contributions.hpp.
#include "host/model/contributions.hpp"

#include <algorithm>

namespace ubs::reduce {

Contributions measure_contributions(Device& device, Renderer& renderer, const DeviceGroups& model,
                                    const RenderSettings& settings, std::size_t views) {
  Contributions out;
  for (const DeviceModel& group : model.groups()) out.splats += group.count();
  out.views = views;
  out.weights.assign(views * out.splats, 0.0f);
  out.most.assign(out.splats, 0.0f);
  out.in_views.assign(out.splats, 0);
  Buffer<float> by_slot(device, "weights by slot", 1);
  std::vector<float> slots;
  renderer.keep_lists();
  for (std::size_t v = 0; v < views; ++v) {
    const ListTotals totals = renderer.forward(model.view(), static_cast<std::uint32_t>(v), settings, false);
    const RasterForward lists = renderer.last_lists();
    by_slot.reserve(lists.sorted_ids.size);
    model.stages().measure_weights({.shape = lists.shape,
                                    .records = lists.records,
                                    .sorted_ids = lists.sorted_ids,
                                    .sorted_slots = lists.sorted_slots,
                                    .tile_ranges = lists.tile_ranges,
                                    .masks = lists.masks,
                                    .weights = by_slot.view()});
    slots.resize(totals.intersections);
    by_slot.download(std::span(slots));
    const auto counts = read_values(device, renderer.tile_counts(), out.splats),
               offsets = read_values(device, renderer.slot_offsets(), out.splats);
    float* row = out.weights.data() + v * out.splats;
    for (std::size_t i = 0; i < out.splats; ++i) {
      for (std::uint32_t s = offsets[i]; s < offsets[i] + counts[i]; ++s) row[i] = std::max(row[i], slots[s]);
      out.most[i] = std::max(out.most[i], row[i]);
      out.in_views[i] += row[i] > 0;
    }
  }
  return out;
}

}  // namespace ubs::reduce
