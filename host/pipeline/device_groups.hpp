// SPDX-License-Identifier: Apache-2.0
// DeviceGroups holds a model on a device. The model consists of one group of splats, or of several groups
// whose splats have different dimensions N. Each group has stages that are compiled for its N. view() can be
// passed to Renderer::forward.
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
  // Creates the stages of each group from `config`, in which N and the variant are replaced by those of the
  // group.
  DeviceGroups(Device& device, const MixedModel& model, KernelConfig config);

  // Replaces the splats by those of `model`, which must have the same variant. For each N, `model` must not
  // have more splats than the capacity of the group with this N. A group whose N does not occur in `model`
  // becomes empty. Throws Error(internal) if `model` has an N for which there is no group.
  void upload(const MixedModel& model);

  std::span<const RenderGroup> view() const { return view_; }
  // Returns the stages for the operations that do not depend on N: tile lists, rasterisation and loss.
  Stages& stages() const { return *stages_.front(); }
  Stages& stages(std::size_t group) const { return *stages_[group]; }
  const std::vector<DeviceModel>& groups() const { return models_; }

 private:
  std::vector<std::unique_ptr<Stages>> stages_;
  std::vector<DeviceModel> models_;
  std::vector<RenderGroup> view_;
};

// GroupBuffers holds one array per group, for example the gradients or the moments. Each array has the layout
// of the group's parameters. All values are initially zero.
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
