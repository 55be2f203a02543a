// SPDX-License-Identifier: Apache-2.0
#include "host/run/verified_device.hpp"

#include "host/base/version.hpp"
#include "host/base/warning.hpp"
#include "host/device/registry.hpp"
#include "host/train/run_settings.hpp"

namespace ubs {
namespace {

check::Gate gate() {
  const auto on_check = [](const DeviceInfo& info) {
    log_line(
        LogLevel::notice,
        fmt::format("first use of {} with this driver and build: comparing its results with float64 values",
                    info.name));
  };
  return {build_id(), on_check, [](const std::string& text) { warn("{}", text); }};
}

std::size_t choose(const std::string& request, const check::Use& use) {
  return check::choose_verified_device(request, use, gate());
}

}  // namespace

check::Use training_use(const TrainSettings& settings) {
  return {[settings](const DeviceInfo& info) {
            return std::vector{kernel_config(settings.dim, settings.variant, settings, info)};
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

check::Use comparing_use(bool networks) {
  check::Use use{[](const DeviceInfo& info) {
                   KernelConfig config;
                   config.raster = raster_kind("auto", info);
                   return std::vector{config};
                 },
                 {check::Part::loss}};
  if (networks) use.parts.push_back(check::Part::networks);
  return use;
}

void verify_device(const DeviceInfo& info, std::size_t index, const check::Use& use) {
  check::verify_device(info, index, use, gate());
}

std::unique_ptr<Device> open_verified_device(const std::string& request, const check::Use& use) {
  return open_device(choose(request, use));
}

std::string verified_request(const std::string& request, const check::Use& use) {
  return std::to_string(choose(request, use));
}

}  // namespace ubs
