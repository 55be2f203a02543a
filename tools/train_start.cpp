// SPDX-License-Identifier: Apache-2.0
#include "tools/train_start.hpp"

#include <filesystem>

#include "host/base/error.hpp"
#include "host/base/output_place.hpp"
#include "host/base/paths.hpp"
#include "host/train/budget.hpp"
#include "tools/common/output.hpp"
#include "tools/common/run_keeper.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

// With --budget the settings start from those of short runs.
TrainSettings resolve_short(const StartOptions& options, const SettingsOptions& given) {
  budget_seconds(options.budget);  // refuses what is none, before anything is loaded
  const TrainSettings settings = given.resolve(short_run_settings());
  if (settings.iterations != TrainSettings{}.iterations)
    fail(ErrorKind::usage, "--budget chooses the iterations: leave out one of the two");
  return settings;
}

}  // namespace

Start start_of(const StartOptions& options, const SettingsOptions& given) {
  if (options.resume.empty()) {
    for (const auto& [name, value] : {std::pair{"--data", &options.data}, {"--out", &options.out}})
      if (value->empty()) fail(ErrorKind::usage, "{} is required (see 'ubs train --help')", name);
    TrainSettings settings = options.budget.empty() ? given.resolve() : resolve_short(options, given);
    check_apart(options.out, {options.data});
    return {options.data, options.out, std::make_unique<FolderLock>(options.out), std::move(settings), {}};
  }
  if (!options.out.empty() || options.overwrite)
    fail(ErrorKind::usage, "--resume goes on in the folder of the run: leave out --out and --overwrite");
  if (!options.budget.empty())
    fail(ErrorKind::usage, "--resume goes on with the schedule of the run: leave out --budget");
  auto lock = is_folder(options.resume) ? std::make_unique<FolderLock>(options.resume) : nullptr;
  Checkpoint checkpoint = open_checkpoint(options.resume);
  const TrainSettings settings = given.resolve(checkpoint.settings);
  check_same_settings(checkpoint.settings, settings);
  return {options.data.empty() ? checkpoint.data : options.data, options.resume, std::move(lock), settings,
          std::move(checkpoint)};
}

Checkpoint identity(const Start& start, const Split& train, const Device& device) {
  Checkpoint run;
  run.settings = start.settings;
  run.data = absolute_path(start.data).lexically_normal().string();
  run.data_print = fingerprint(train);
  run.device = device_text(device.info());
  run.build = build_id();
  if (start.checkpoint) run.planned_seconds = start.checkpoint->planned_seconds;
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

}  // namespace ubs::tools
