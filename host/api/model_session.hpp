// SPDX-License-Identifier: Apache-2.0
// A model file on a device, ready to be drawn.
#pragma once

#include <memory>
#include <string>

#include "host/data/splat_file.hpp"
#include "host/device/registry.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

// A model file of any format; what reading it dropped and noticed is logged as warnings.
LoadedModel open_model(const std::string& path);

// The defaults, and in their place how the model says that it wants to be drawn. Throws Error(data) that
// starts with `path` for notes that make no sense.
TrainSettings noted_settings(const ModelNotes& notes, const std::string& path);

// Dimension and form of the method are those of the model's first group, whatever the settings say; nothing
// is frozen.
KernelConfig config_for(const Device& device, const MixedModel& model, const TrainSettings& settings,
                        bool depth, bool backward);

class ModelSession {
 public:
  // Uploads the model; the renderer has no cameras yet.
  ModelSession(std::shared_ptr<Device> device, const MixedModel& model, const TrainSettings& settings,
               bool depth, bool backward = false);
  // Opens the device, proved for this, and uploads the model and the cameras of the split.
  ModelSession(const std::string& device, const MixedModel& model, const Split& split,
               const TrainSettings& settings, bool depth, bool backward = false);

  Device& device() { return *device_; }
  Stages& stages() { return model_.stages(); }
  Renderer& renderer() { return renderer_; }
  const DeviceGroups& model() const { return model_; }
  // A choice of the splats that it was made with.
  void choose(const MixedModel& part) { model_.upload(part); }
  const RenderSettings& settings() const { return settings_; }

 private:
  std::shared_ptr<Device> device_;
  DeviceGroups model_;
  Renderer renderer_;
  RenderSettings settings_;
};

}  // namespace ubs
