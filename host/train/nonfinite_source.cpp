// SPDX-License-Identifier: Apache-2.0
#include "host/train/nonfinite_source.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "kernels/layout.h"

namespace ubs {
namespace {

bool all_finite(std::span<const float> values) {
  return std::ranges::all_of(values, [](float v) { return std::isfinite(v); });
}

}  // namespace

NonFiniteSource find_nonfinite_source(Device& device, Stages& stages, TrainingViews& views,
                                      const RenderSettings& settings, const TrainState& state) {
  if (!all_finite(state.model.values)) return {"parameters"};
  try {
    const DeviceModel model(device, state.model);
    Buffer<float> v_params(device, "parameter gradients",
                           static_cast<std::size_t>(model.rows()) * model.stride());
    v_params.zero();
    Buffer<float> sums(device, "loss sums", 8);
    Renderer renderer(device, stages);
    const auto finite_image = [&](const BufferView<float>& planes) {  // pixels beyond the image are undefined
      return all_finite(cropped_planes(read_values(device, planes, planes.size), renderer.shape()));
    };
    const auto finite_records = [&] {  // records of culled splats are undefined
      const BufferView<float> view = renderer.last_lists().records;
      const std::vector<float> records = read_values(device, view, view.size);
      const auto tiles = read_values(device, renderer.tile_counts(), state.model.count);
      for (std::size_t i = 0; i < tiles.size(); ++i)
        if (tiles[i] > 0 && !all_finite(std::span(records).subspan(i * kSplatStride, kSplatDepth + 1)))
          return false;
      return true;
    };
    const std::uint64_t first = views.first_draw(state.iteration);
    for (std::uint64_t draw = first; draw < first + views.batch(); ++draw) {
      const std::uint32_t view = views.view_of(draw);
      renderer.set_cameras({views.camera(view)});
      if (!state.sky.empty()) renderer.set_sky(settings.sky.value(), state.sky);
      renderer.forward(model.view(), 0, settings, true);
      if (!finite_records()) return {"project_forward", view};
      if (!finite_image(renderer.image())) return {"raster_forward", view};
      stages.image_loss(views.loss(renderer, draw, sums.view()));
      const std::vector<float> loss = sums.download();
      if (!finite_image(renderer.v_image()) || !all_finite(std::span(loss).first(5)))
        return {"image_loss", view};
      renderer.backward_to_records();
      const BufferView<float> v_records = renderer.v_records();
      if (!all_finite(read_values(device, v_records, v_records.size))) return {"raster_backward", view};
      const BufferView<float> gradient = v_params.view();
      renderer.backward_from_records(std::span(&gradient, 1), false);
      if (!all_finite(download_rows(v_params, model.layout(), model.count(), model.stride()).values))
        return {"project_backward", view};
    }
    return {"adam", views.batch() == 1 ? static_cast<std::int64_t>(views.view_of(first)) : -1};
  } catch (const std::exception&) {  // for example, the device has no memory for a second model
    return {"unknown"};
  }
}

}  // namespace ubs
