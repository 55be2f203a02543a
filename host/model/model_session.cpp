// SPDX-License-Identifier: Apache-2.0
#include "host/model/model_session.hpp"

#include "host/base/error.hpp"
#include "host/base/warning.hpp"
#include "host/run/open_data.hpp"
#include "host/run/verified_device.hpp"
#include "host/settings/fields.hpp"
#include "host/train/run_settings.hpp"

namespace ubs {

LoadedModel open_model(const std::string& path) {
  LoadedModel loaded = load_splat_model(path);
  for (const std::string& remark : loaded.remarks) warn("{}", remark);
  return loaded;
}

TrainSettings noted_settings(const ModelNotes& notes, const std::string& path) {
  TrainSettings settings;
  const std::vector<FieldValue> fields = bind_fields(settings, train_fields());
  for (const auto& [key, value] : notes.drawing) {
    try {
      set_field(fields, key, value, path);
    } catch (const Error& error) {
      fail(ErrorKind::data, "{}", error.what());
    }
  }
  return settings;
}

KernelConfig config_for(const Device& device, const MixedModel& model, const TrainSettings& settings,
                        bool depth, bool backward) {
  KernelConfig config = kernel_config(model.dim(), model.variant(), settings, device.info());
  config.depth = depth;
  config.backward = backward;
  config.depth_grad = depth && backward;
  return config;
}

ModelSession::ModelSession(std::shared_ptr<Device> device, const MixedModel& model,
                           const TrainSettings& settings, const KernelConfig& config)
    : device_(std::move(device)),
      model_(*device_, model, config),
      renderer_(*device_, model_.stages()),
      settings_(render_settings(settings)) {}

ModelSession::ModelSession(std::shared_ptr<Device> device, const MixedModel& model,
                           const TrainSettings& settings, bool depth, bool backward)
    : ModelSession(device, model, settings, config_for(*device, model, settings, depth, backward)) {}

ModelSession::ModelSession(const std::string& device, const MixedModel& model, const Split& split,
                           const TrainSettings& settings, bool depth, bool backward)
    : ModelSession(open_verified_device(device, drawing_use(model, settings, backward)), model, settings,
                   depth, backward) {
  for (const SplatModel& group : model.groups) check_query(split, group.dim);
  renderer_.set_cameras(cameras_of(split));
}

}  // namespace ubs
