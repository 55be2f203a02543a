// SPDX-License-Identifier: Apache-2.0
#include "tools/train_start.hpp"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <initializer_list>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/formats/splat_file.hpp"
#include "host/run/same_run.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/run_writer.hpp"

namespace ubs::tools {

namespace {

// Returns whether the folder contains only the lock file of a run that ended before its first step. Returns
// false if a run in progress holds the lock.
bool is_left_empty(const std::filesystem::path& folder) {
  try {
    const auto entries = folder_entries(folder);
    if (entries.size() != 1 || entries[0].filename() != ".ubs-lock") return false;
    const FolderLock lock(folder);
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

// Throws an error with an explanation if the extension shows that the file is of a kind that is often passed
// by mistake.
void check_kind(const std::filesystem::path& data) {
  if (is_folder(data)) return;
  const std::string extension = small_extension(data);
  const auto is = [&](std::initializer_list<const char*> names) {
    return std::ranges::find(names, extension) != names.end();
  };
  const std::string name = shell_word(data.string());
  // Files of ubs web and of GaussianSplats3D are models too, but has_splat_extension() does not include them.
  if (has_splat_extension(data) || is({".ubsz", ".ksplat"}))
    fail(ErrorKind::data,
         "{}: this is a model, not a data set: show it with 'ubs view {}', or pass the folder of "
         "its images",
         data.string(), name);
  refuse_pictures(data);
}

}  // namespace

void refuse_pictures(const std::filesystem::path& file) {
  if (const std::string hint = how_to_make_images(file); !hint.empty())
    fail(ErrorKind::data, "{}: {}", file.string(), hint);
  if (has_image_extension(file) || small_extension(file) == ".avif")  // ubs does not read .avif files
    fail(ErrorKind::data,
         "{}: this is one image: pass a folder of images with their cameras ('ubs cameras FOLDER' "
         "finds the cameras)",
         file.string());
}

std::filesystem::path free_output_folder(const std::filesystem::path& data) {
  namespace fs = std::filesystem;
  fs::path at = fs::absolute(data).lexically_normal();
  if (!at.has_filename()) at = at.parent_path();  // after a trailing slash
  fs::path folder = at.parent_path();
  const fs::path here = fs::current_path();
  if (access(folder.c_str(), W_OK | X_OK) != 0) folder = here;
  const std::string name = (is_folder(at) ? at.filename() : at.stem()).string() + "-ubs";
  for (int i = 1;; ++i) {
    const fs::path out = folder / (i == 1 ? name : fmt::format("{}-{}", name, i));
    if (path_exists(out) && !is_left_empty(out)) continue;
    return folder == here ? out.filename() : out;
  }
}

Start start_of(const StartOptions& options, const SettingsOptions& given, bool holds) {
  if (options.resume.empty()) {
    if (options.data.empty())
      fail(ErrorKind::usage, "no data folder given: ubs train FOLDER (see 'ubs train --help')");
    Start start{.settings = given.resolve()};
    if (!path_exists(options.data)) fail(ErrorKind::data, "{}: no such data folder", options.data);
    check_kind(options.data);
    start.data = options.data;
    start.out = options.out.empty() ? free_output_folder(options.data).string() : options.out;
    check_outside(start.out, {options.data});
    if (holds) start.lock = std::make_unique<FolderLock>(start.out);
    return start;
  }
  if (!options.out.empty() || options.overwrite)
    fail(ErrorKind::usage, "--resume continues in the folder of the run: remove --out and --overwrite");
  auto lock = holds && is_folder(options.resume) ? std::make_unique<FolderLock>(options.resume) : nullptr;
  const std::string budget = given.apply({}).budget;
  std::optional<double> more_seconds;
  if (budget != TrainSettings{}.budget) {
    if (!budget.starts_with('+'))
      fail(ErrorKind::usage,
           "--budget {0}: for a resumed run, pass the remaining time with a plus sign: --budget +{0}",
           budget);
    more_seconds = parse_duration(budget.substr(1), "budget");
  }
  Checkpoint checkpoint = open_checkpoint(options.resume, more_seconds.has_value());
  TrainSettings settings = given.apply(checkpoint.settings);
  settings.budget = checkpoint.settings.budget;
  validate(settings);
  check_same_settings(checkpoint.settings, settings);
  for (const auto& [key, value] : checkpoint.unused_settings)
    if (holds && !settings.chosen.contains(key))
      remark(
          "ubs: the run was started with {0} = {1}, which is not used, because only the command line can "
          "set it: pass --set {0}={1} to use it again\n",
          key, shell_word(value));
  if (more_seconds) {
    checkpoint.budget.seconds = checkpoint.state.seconds + *more_seconds;
    if (checkpoint.is_finished()) checkpoint.budget.most_iterations += checkpoint.state.iteration;
    settings.work_shares = shares_until(settings, checkpoint.state.iteration);
  }
  // The checkpoint has fixed all settings. Those of reading do not count as set by the user, because the run
  // may be resumed with a packed copy of its data (open_data.cpp).
  for (const Field<TrainSettings>& field : train_fields())
    if (!(field.uses & kOfReading)) settings.chosen.insert(field.key);
  return {settings,
          options.data.empty() ? checkpoint.data : options.data,
          options.resume,
          std::move(lock),
          std::move(checkpoint),
          more_seconds.has_value()};
}

}  // namespace ubs::tools
