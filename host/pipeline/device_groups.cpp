// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/device_groups.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/device/operations.hpp"

namespace ubs {

DeviceGroups::DeviceGroups(Device& device, const MixedModel& model, KernelConfig config) {
  check_groups(model);
  for (const SplatModel& group : model.groups) {
    config.dim = group.dim;
    config.variant = group.variant;
    stages_.push_back(make_stages(device, config));
    models_.emplace_back(device, group);
  }
  for (std::size_t g = 0; g < models_.size(); ++g) view_.push_back({stages_[g].get(), models_[g].view()});
}

void DeviceGroups::upload(const MixedModel& model) {
  for (const SplatModel& group : model.groups)
    if (std::ranges::none_of(models_, [&](const DeviceModel& own) { return own.dim() == group.dim; }))
      fail(ErrorKind::internal, "the model on the device has no group with N = {}", group.dim);
  for (std::size_t g = 0; g < models_.size(); ++g) {
    const auto found = std::ranges::find(model.groups, models_[g].dim(), &SplatModel::dim);
    models_[g].upload(
        found != model.groups.end() ? *found : SplatModel(models_[g].dim(), 0, models_[g].layout().variant));
    view_[g].splats = models_[g].view();
  }
}

GroupBuffers::GroupBuffers(Device& device, const DeviceGroups& model, const char* label) {
  for (const DeviceModel& group : model.groups()) {
    buffers_.emplace_back(device, label, static_cast<std::size_t>(group.rows()) * group.stride());
    buffers_.back().zero();
    view_.push_back(buffers_.back().view());
  }
}

}  // namespace ubs
