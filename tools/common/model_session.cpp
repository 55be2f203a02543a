// SPDX-License-Identifier: Apache-2.0
#include "tools/common/model_session.hpp"

#include "tools/common/dataset.hpp"

namespace ubs::tools {
namespace {

std::unique_ptr<Stages> stages_for(Device& device, int dim, const TrainSettings& settings, bool depth) {
  return make_stages(device, {.dim = dim,
                              .raster = raster_kind(settings.raster, device.info()),
                              .query_grad = settings.query_grad,
                              .depth = depth});
}

}  // namespace

ModelOptions::ModelOptions(CLI::App& app, std::vector<std::string_view> keys)
    : settings(app, std::move(keys)) {
  app.add_option("--model", model, "splat model (.ply)")->required()->type_name("FILE");
  app.add_option("--data", data, "data folder with transforms_<split>.json, or packed file")
      ->required()
      ->type_name("DIR|FILE");
  app.add_option("--split", split, "train, val or test [test]")->type_name("NAME");
  add_device_option(app, device);
}

void add_device_option(CLI::App& app, std::string& device) {
  app.add_option(
         "--device", device,
         "index, cpu, gpu, cuda, opencl, or part of a name, as listed by 'ubs devices'; opencl:NAME looks in one "
         "back end only [UBS_DEVICE, else the first GPU]")
      ->type_name("DEVICE");
}

RenderSettings render_settings(const TrainSettings& settings) {
  RenderSettings render;
  render.projection = {static_cast<float>(settings.near_plane), static_cast<float>(settings.far_plane),
                       static_cast<float>(settings.eps2d)};
  for (std::size_t c = 0; c < 3; ++c) render.background[c] = static_cast<float>(settings.background[c]);
  return render;
}

ModelSession::ModelSession(const std::string& device, const SplatModel& model, const Split& split,
                           const TrainSettings& settings, bool depth)
    : device_(open_device(device)),
      stages_(stages_for(*device_, model.dim, settings, depth)),
      model_(*device_, model),
      renderer_(*device_, *stages_),
      settings_(render_settings(settings)) {
  check_query(split, model.dim);
  renderer_.set_cameras(cameras_of(split));
}

}  // namespace ubs::tools
