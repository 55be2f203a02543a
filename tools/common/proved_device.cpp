// SPDX-License-Identifier: Apache-2.0
#include "tools/common/proved_device.hpp"

#include <unistd.h>

#include "host/device/registry.hpp"
#include "host/train/run_settings.hpp"
#include "tools/common/output.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

std::size_t choose(const std::string& request, const check::Use& use) {
  const auto on_check = [](const DeviceInfo& info) {
    if (isatty(STDERR_FILENO) == 1)
      remark("ubs: first use of {} with this driver and build: it is compared with float64\n", info.name);
  };
  return check::choose_proved_device(
      request, use, {build_id(), on_check, [](const std::string& text) { warn("{}", text); }});
}

}  // namespace

check::Use training_use(const TrainSettings& settings) {
  return {[settings](const DeviceInfo& info) {
            return std::vector{kernel_config(settings.dim, model_variant(settings), settings, info)};
          },
          check::kTraining};
}

check::Use drawing_use(const MixedModel& model, const TrainSettings& settings, bool backward) {
  std::vector<std::pair<int, ModelVariant>> forms;
  for (const SplatModel& group : model.groups) forms.emplace_back(group.dim, group.variant);
  const auto configs = [=](const DeviceInfo& info) {
    std::vector<KernelConfig> all;
    for (const auto& [dim, variant] : forms) {
      all.push_back(kernel_config(dim, variant, settings, info));
      all.back().backward = backward;
    }
    return all;
  };
  check::Use use{configs, {check::Part::drawing}};
  if (backward) use.parts = {check::Part::drawing, check::Part::loss, check::Part::gradients};
  return use;
}

std::unique_ptr<Device> open_proved_device(const std::string& request, const check::Use& use) {
  return open_device(choose(request, use));
}

std::string proved_request(const std::string& request, const check::Use& use) {
  return std::to_string(choose(request, use));
}

}  // namespace ubs::tools
