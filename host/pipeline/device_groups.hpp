// SPDX-License-Identifier: Apache-2.0
// DeviceGroups is a model on a device, as one group of splats or several groups of different dimensions. Each
// group has stages for its N. view() can be passed to Renderer::forward.
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
  // Creates the stages of each group from `config`, with N and the variant of the group.
  DeviceGroups(Device& device, const MixedModel& model, KernelConfig config);

  // Replaces the splats. `model` may have at most as many splats of each N as the groups have room for, and
  // must have the same variant. Groups that `model` lacks become empty. Throws Error(internal) if `model` has
  // an N for which there is no group.
  void upload(const MixedModel& model);

  std::span<const RenderGroup> view() const { return view_; }
  // Stages for operations that do not depend on N: lists, rasteriser, loss.
  Stages& stages() const { return *stages_.front(); }
  Stages& stages(std::size_t group) const { return *stages_[group]; }
  const std::vector<DeviceModel>& groups() const { return models_; }

 private:
  std::vector<std::unique_ptr<Stages>> stages_;
  std::vector<DeviceModel> models_;
  std::vector<RenderGroup> view_;
};

// GroupBuffers holds an array in the layout of the parameters for each group, such as gradients or moments.
// The values are initially zero.
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
