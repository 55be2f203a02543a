// SPDX-License-Identifier: Apache-2.0
// A model of one or several groups on a device, each with stages for its N, ready for Renderer::forward.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

class DeviceGroups {
 public:
  // Of `config` the groups replace N and the form.
  DeviceGroups(Device& device, const MixedModel& model, KernelConfig config);

  // Other splats in the place of these: at most as many of each N, of the same form; groups that `model`
  // lacks become empty. Throws Error(internal) for an N that is not there.
  void upload(const MixedModel& model);

  std::span<const RenderGroup> view() const { return view_; }
  // For what does not depend on N: lists, rasteriser, loss.
  Stages& stages() const { return *stages_.front(); }
  Stages& stages(std::size_t group) const { return *stages_[group]; }
  const std::vector<DeviceModel>& groups() const { return models_; }

 private:
  std::vector<std::unique_ptr<Stages>> stages_;
  std::vector<DeviceModel> models_;
  std::vector<RenderGroup> view_;
};

// An array in the layout of the parameters for each group: gradients, moments. Zero at first.
class GroupBuffers {
 public:
  GroupBuffers(Device& device, const DeviceGroups& model, const char* label);
  std::span<const BufferView<float>> view() const { return view_; }
  const Buffer<float>& operator[](std::size_t group) const { return buffers_[group]; }

 private:
  std::vector<Buffer<float>> buffers_;
  std::vector<BufferView<float>> view_;
};

}  // namespace ubs
