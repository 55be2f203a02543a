// SPDX-License-Identifier: Apache-2.0
#include "tools/common/model_session.hpp"

#include "host/train/run_settings.hpp"
#include "tools/common/dataset.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

ModelOptions::ModelOptions(CLI::App& app, std::vector<std::string_view> keys)
    : settings(app, std::move(keys)) {
  app.add_option("model,--model", model, "splat model (.ply; files of other tools are imported)")
      ->required()
      ->type_name("FILE");
  app.add_option("--data", data, "data folder (Blender, nerfstudio, COLMAP, LLFF, N3V) or packed file")
      ->required()
      ->type_name("DIR|FILE");
  split_option_ = app.add_option("--split", split, "train, val or test [test]")->type_name("NAME");
  add_device_option(app, device);
}

void add_device_option(CLI::App& app, std::string& device) {
  app.add_option(
         "--device", device,
         "index, cpu, gpu, cuda, opencl, or part of a name, as listed by 'ubs devices'; opencl:NAME looks in one "
         "back end only [UBS_DEVICE, else the first GPU]")
      ->type_name("DEVICE");
}

LoadedModel open_model(const std::string& path) {
  LoadedModel loaded = load_splat_model(path);
  for (const std::string& remark : loaded.remarks) warn("{}", remark);
  return loaded;
}

KernelConfig config_for(const Device& device, const MixedModel& model, const TrainSettings& settings, bool depth,
                        bool backward) {
  KernelConfig config = kernel_config(model.dim(), model.variant(), settings, device.info());
  config.depth = depth;
  config.backward = backward;
  return config;
}

ModelSession::ModelSession(const std::string& device, const MixedModel& model, const Split& split,
                           const TrainSettings& settings, bool depth, bool backward)
    : device_(open_device(device)),
      model_(*device_, model, config_for(*device_, model, settings, depth, backward)),
      renderer_(*device_, model_.stages()),
      settings_(render_settings(settings)) {
  for (const SplatModel& group : model.groups) check_query(split, group.dim);
  renderer_.set_cameras(cameras_of(split));
}

}  // namespace ubs::tools
