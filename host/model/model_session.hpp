// SPDX-License-Identifier: Apache-2.0
// ModelSession holds a model on a device, together with a renderer for it and the settings for rendering.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "host/device/registry.hpp"
#include "host/formats/splat_file.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/scene/dataset.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {

// Opens a model file of any format. Logs a warning for each remark of the reader, for example about splats
// that it dropped.
LoadedModel open_model(const std::string& path);

// Returns settings for rendering a model: the values that are stored in the model file, and the defaults for
// all other settings. Throws Error(data) for invalid values; the message starts with `path`.
TrainSettings noted_settings(const ModelNotes& notes, const std::string& path);

// Returns the kernel configuration for rendering a model. Dimension and variant are those of the first group
// of the model, not those of the settings, and no parameters are frozen. KernelConfig explains `depth` and
// `backward`.
KernelConfig config_for(const Device& device, const MixedModel& model, const TrainSettings& settings,
                        bool depth, bool backward);

class ModelSession {
 public:
  // Uploads the model; the renderer has no cameras yet.
  ModelSession(std::shared_ptr<Device> device, const MixedModel& model, const TrainSettings& settings,
               bool depth, bool backward = false);
  ModelSession(std::shared_ptr<Device> device, const MixedModel& model, const TrainSettings& settings,
               const KernelConfig& config);
  // Opens the device after verifying it for this use, and uploads the model and the cameras of the split.
  ModelSession(const std::string& device, const MixedModel& model, const Split& split,
               const TrainSettings& settings, bool depth, bool backward = false);

  Device& device() { return *device_; }
  Stages& stages() { return model_.stages(); }
  Renderer& renderer() { return renderer_; }
  const DeviceGroups& model() const { return model_; }
  // Replaces the splats on the device by `part`, a subset of the splats that the session was created with.
  void choose(const MixedModel& part) { model_.upload(part); }
  const RenderSettings& settings() const { return settings_; }

 private:
  std::shared_ptr<Device> device_;
  DeviceGroups model_;
  Renderer renderer_;
  RenderSettings settings_;
};

}  // namespace ubs
