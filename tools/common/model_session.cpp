// SPDX-License-Identifier: Apache-2.0
#include "tools/common/model_session.hpp"

#include "host/train/run_settings.hpp"
#include "tools/common/dataset.hpp"
#include "tools/common/output.hpp"
#include "tools/common/proved_device.hpp"

namespace ubs::tools {

ModelOptions::ModelOptions(CLI::App& app, std::vector<std::string_view> keys)
    : import(app), settings(app, std::move(keys)) {
  app.add_option("model,--model", model, "splat model of any format (docs/data.md)")
      ->required()
      ->type_name("FILE");
  app.add_option("--data", data, "data folder (Blender, nerfstudio, COLMAP, LLFF, N3V) or packed file")
      ->required()
      ->type_name("DIR|FILE");
  split_option_ = app.add_option("--split", split, "train, val or test [test]")->type_name("NAME");
  add_device_option(app, device);
}

void add_device_option(CLI::App& app, std::string& device) {
  app.add_option("--device", device,
                 "index, cpu, gpu, cuda, opencl, or part of a name, as listed by 'ubs devices'; opencl:NAME "
                 "looks in one "
                 "back end only [UBS_DEVICE, else the first GPU]")
      ->type_name("DEVICE");
}

ImportChoice::ImportChoice(CLI::App& app) {
  app.add_option("--import", form_,
                 "files of other tools: exact, as Gaussians with harmonics, or beta, the published form with "
                 "the error "
                 "that this causes [exact]")
      ->check(CLI::IsMember({"exact", "beta"}))
      ->type_name("exact|beta");
  app.add_option("--support", support_,
                 "support radius / sigma with --import beta: 3.0 as published, 3.08 fits best [3.08]")
      ->type_name("RATIO");
}

ImportOptions ImportChoice::options(int dim) const {
  return {.form = form_ == "beta" ? ImportForm::beta : ImportForm::exact, .dim = dim, .support = support_};
}

LoadedModel open_model(const std::string& path, const ImportOptions& import) {
  LoadedModel loaded = load_splat_model(path, import);
  for (const std::string& remark : loaded.remarks) warn("{}", remark);
  return loaded;
}

KernelConfig config_for(const Device& device, const MixedModel& model, const TrainSettings& settings,
                        bool depth, bool backward) {
  KernelConfig config = kernel_config(model.dim(), model.variant(), settings, device.info());
  config.depth = depth;
  config.backward = backward;
  return config;
}

ModelSession::ModelSession(const std::string& device, const MixedModel& model, const Split& split,
                           const TrainSettings& settings, bool depth, bool backward)
    : device_(open_proved_device(device, drawing_use(model, settings, backward))),
      model_(*device_, model, config_for(*device_, model, settings, depth, backward)),
      renderer_(*device_, model_.stages()),
      settings_(render_settings(settings)) {
  for (const SplatModel& group : model.groups) check_query(split, group.dim);
  renderer_.set_cameras(cameras_of(split));
}

}  // namespace ubs::tools
