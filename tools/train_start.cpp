// SPDX-License-Identifier: Apache-2.0
#include "tools/train_start.hpp"

#include <unistd.h>

#include <filesystem>

#include "host/base/error.hpp"
#include "host/base/output_place.hpp"
#include "host/base/paths.hpp"
#include "tools/common/output.hpp"
#include "tools/common/run_keeper.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {

std::filesystem::path free_output_folder(const std::filesystem::path& data) {
  namespace fs = std::filesystem;
  fs::path at = absolute_path(data).lexically_normal();
  if (!at.has_filename()) at = at.parent_path();  // a slash at the end
  fs::path folder = at.parent_path();
  const fs::path here = absolute_path("x").lexically_normal().parent_path();
  if (access(folder.c_str(), W_OK | X_OK) != 0) folder = here;
  const std::string name = (is_folder(at) ? at.filename() : at.stem()).string() + "-ubs";
  for (int i = 1;; ++i) {
    const fs::path out = folder / (i == 1 ? name : fmt::format("{}-{}", name, i));
    if (path_exists(out)) continue;
    return folder == here ? out.filename() : out;
  }
}

Start start_of(const StartOptions& options, const SettingsOptions& given) {
  if (options.resume.empty()) {
    if (options.data.empty()) fail(ErrorKind::usage, "which data? ubs train FOLDER (see 'ubs train --help')");
    TrainSettings base;
    base.dim = kAutoInt;
    TrainSettings settings = given.resolve(base);
    if (!path_exists(options.data)) fail(ErrorKind::data, "{}: no such data folder", options.data);
    const std::string out = options.out.empty() ? free_output_folder(options.data).string() : options.out;
    check_apart(out, {options.data});
    return {options.data, out, std::make_unique<FolderLock>(out), std::move(settings), {}};
  }
  if (!options.out.empty() || options.overwrite)
    fail(ErrorKind::usage, "--resume goes on in the folder of the run: leave out --out and --overwrite");
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
