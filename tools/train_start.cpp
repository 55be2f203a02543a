// SPDX-License-Identifier: Apache-2.0
#include "tools/train_start.hpp"

#include <filesystem>

#include "host/base/error.hpp"
#include "host/base/output_place.hpp"
#include "host/base/paths.hpp"
#include "host/run/same_run.hpp"
#include "host/train/budget.hpp"
#include "tools/common/output.hpp"
#include "tools/common/run_keeper.hpp"

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
  Checkpoint run =
      identity(start.settings, absolute_path(start.data).lexically_normal().string(), train, device);
  if (start.checkpoint) run.planned_seconds = start.checkpoint->planned_seconds;
  return run;
}

}  // namespace ubs::tools
