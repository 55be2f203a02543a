// SPDX-License-Identifier: Apache-2.0
#include "host/run/same_run.hpp"

#include "host/base/error.hpp"
#include "host/base/version.hpp"
#include "host/base/warning.hpp"

namespace ubs {

std::string device_text(const DeviceInfo& info) {
  std::string text = fmt::format("{}, {} lanes", describe(info), info.float_vector_width);
  for (const auto& [macro, value] : info.tuning) text += fmt::format(", {}={}", macro, value);
  return text;
}

Checkpoint identity(const TrainSettings& settings, std::string data, const Split& train,
                    const Device& device) {
  Checkpoint run;
  run.settings = settings;
  run.data = std::move(data);
  run.data_print = fingerprint(train);
  run.device = device_text(device.info());
  run.build = build_id();
  return run;
}

void check_same_run(const Checkpoint& before, const Checkpoint& now, bool any_device) {
  if (before.data_print != now.data_print)
    fail(ErrorKind::data, "{}: cameras, names or images are not those that the run was started with ({})",
         now.data, before.data);
  if (before.device != now.device && !any_device)
    fail(ErrorKind::data,
         "the run was started on '{}', this is '{}': its results would not be the same bits; choose that "
         "device with "
         "--device, or go on all the same with --any-device",
         before.device, now.device);
  if (before.build != now.build)
    warn(
        "the run was started by another build of this program; its results may differ from an uninterrupted "
        "run");
}

}  // namespace ubs
