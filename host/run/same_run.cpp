// SPDX-License-Identifier: Apache-2.0
#include "host/run/same_run.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/version.hpp"
#include "host/base/warning.hpp"
#include "host/settings/fields.hpp"

namespace ubs {

std::string device_text(const DeviceInfo& info) {
  std::string text = fmt::format("{}, {} lanes", describe(info), info.float_vector_width);
  for (const auto& [macro, value] : info.tuning) text += fmt::format(", {}={}", macro, value);
  return text;
}

Checkpoint identity(const TrainSettings& settings, std::string data, std::uint32_t data_print,
                    const Device& device) {
  Checkpoint run;
  run.settings = settings;
  run.data = std::move(data);
  run.data_print = data_print;
  run.device = device_text(device.info());
  run.build = build_id();
  return run;
}

void check_same_run(const Checkpoint& before, const Checkpoint& now, bool any_device) {
  if (before.data_print != now.data_print)
    fail(ErrorKind::data, "{}: cameras, names or images differ from those that the run was started with ({})",
         now.data, before.data);
  if (before.device != now.device && !any_device)
    fail(ErrorKind::data,
         "the run was started on '{}', but this device is '{}', so results would not be bit-identical: "
         "select the original device with --device, or continue here with "
         "`ubs train --resume RUN --any-device`",
         before.device, now.device);
  if (before.build != now.build)
    warn(
        "the run was started by another build of this program: its results may differ from those of an "
        "uninterrupted run");
}

bool has_fingerprint(const Dataset& data, std::uint32_t print) {
  const Split* const train = data.find("train");
  return train && !train->views.empty() && fingerprint(*train) == print;
}

int join_run(Communicator& ranks, Checkpoint& run) {
  if (ranks.size() == 1) return 1;
  TrainSettings settings = run.settings;
  const std::array<std::pair<const char*, std::string>, 3> parts{
      {{"another build of ubs", run.build},
       {"other data", std::to_string(run.data_print)},
       {"other settings", to_yaml(bind_fields(settings, train_fields()))}}};
  for (const auto& [what, own] : parts) {
    const std::vector<std::string> all = ranks.all_texts(own);
    for (std::size_t r = 1; r < all.size(); ++r)
      if (all[r] != all[0])
        fail(ErrorKind::usage,
             "rank {} has {} than the first rank: start all ranks of a job with the same build, data and "
             "settings",
             r, what);
  }
  std::vector<std::string> devices;  // in the order of the ranks
  for (const std::string& device : ranks.all_texts(run.device))
    if (std::ranges::find(devices, device) == devices.end()) devices.push_back(device);
  const auto kinds = static_cast<int>(devices.size());
  run.device = fmt::format("{}", fmt::join(devices, " + "));
  if (kinds > 1)
    warn(
        "the ranks have {} kinds of devices: results are reproducible only with the same devices in the same "
        "order, and differ from those of a single kind of device",
        kinds);
  return kinds;
}

}  // namespace ubs
