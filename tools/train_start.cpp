// SPDX-License-Identifier: Apache-2.0
#include "tools/train_start.hpp"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <initializer_list>

#include "host/api/same_run.hpp"
#include "host/api/training_data.hpp"
#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/data/splat_file.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/run_keeper.hpp"

namespace ubs::tools {

constexpr double kLeastBudget = 0.5;  // [s]; measuring steps and kMinIterations take longer on every device

// Number of initial points that are searched for per second of the budget
// (docs/results/2026-11-29-time-before-training.md).
constexpr double kFoundPerSecond = 1000;

// With --budget, the returned settings are those of fast runs. Without --budget and --iterations, the
// settings of fast runs replace the returned ones as soon as the data are known.
NewSettings resolve_new(const SettingsOptions& given, const std::string& budget) {
  constexpr int kUnsaid = 0;
  const bool asked = !budget.empty();
  // Throws for a budget that is invalid or too short, before anything is loaded.
  if (asked && time_budget_seconds(budget) < kLeastBudget)
    fail(ErrorKind::usage, "--budget {}: training takes at least {:g} s: increase the budget", budget,
         kLeastBudget);
  const auto resolved = [&](TrainSettings base) {
    base.dim = kAutoInt;
    base.iterations = kUnsaid;
    return given.resolve(base);
  };
  NewSettings run{.settings = resolved({}), .fast = {}};
  const bool unsaid = run.settings.iterations == kUnsaid;
  if (asked && !unsaid)
    fail(ErrorKind::usage,
         "--budget chooses the number of iterations: remove --budget or --iterations (in a file of settings, "
         "the line 'iterations')");
  if (!unsaid) return run;
  run.settings.iterations = TrainSettings{}.iterations;
  run.fast = resolved(fast_settings());
  run.fast->iterations = run.settings.iterations;
  if (!asked) return run;
  if (!run.fast->chosen.contains("find_points"))
    run.fast->find_points = static_cast<int>(
        std::min(kFoundPerSecond * time_budget_seconds(budget), 1.0 * run.fast->find_points));
  run.settings = *run.fast;
  return run;
}

TrainSettings fast_base(const NewSettings& run) {
  TrainSettings base = *run.fast;
  base.dim = run.settings.dim;
  base.variant = run.settings.variant;
  base.background = run.settings.background;
  base.random_background = run.settings.random_background;
  base.unit = run.settings.unit;
  base.conditioning_auto = false;
  return base;
}

std::size_t points_of(const Dataset& data) { return data.points ? data.points->positions.size() : 0; }

TrainSettings default_settings(const NewSettings& run, const Dataset& data, const PictureFacts& pictures) {
  return fast_settings_for(fast_base(run), kDefaultIterations, points_of(data), pictures);
}

namespace {

// Returns whether the folder contains only the lock file of a run that ended before its first step. Returns
// false if a run in progress holds the lock.
bool is_left_empty(const std::filesystem::path& folder) {
  try {
    const auto entries = folder_entries(folder);
    if (entries.size() != 1 || entries[0].filename() != ".ubs-lock") return false;
    const FolderLock lock(folder);
    return true;
  } catch (const Error&) {
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
    Start start{resolve_new(given, options.budget)};
    if (!path_exists(options.data)) fail(ErrorKind::data, "{}: no such data folder", options.data);
    check_kind(options.data);
    start.data = options.data;
    start.out = options.out.empty() ? free_output_folder(options.data).string() : options.out;
    check_apart(start.out, {options.data});
    if (holds) start.lock = std::make_unique<FolderLock>(start.out);
    return start;
  }
  if (!options.out.empty() || options.overwrite)
    fail(ErrorKind::usage, "--resume continues in the folder of the run: remove --out and --overwrite");
  std::optional<double> more_seconds;
  if (!options.budget.empty()) {
    if (!options.budget.starts_with('+'))
      fail(ErrorKind::usage,
           "--budget {0}: for a resumed run, pass the remaining time with a plus sign: --budget +{0}",
           options.budget);
    more_seconds = time_budget_seconds(options.budget.substr(1));
  }
  auto lock = holds && is_folder(options.resume) ? std::make_unique<FolderLock>(options.resume) : nullptr;
  Checkpoint checkpoint = open_checkpoint(options.resume, more_seconds.has_value());
  TrainSettings settings = given.resolve(checkpoint.settings);
  check_same_settings(checkpoint.settings, settings);
  if (more_seconds) {
    checkpoint.budget.seconds = checkpoint.state.seconds + *more_seconds;
    if (checkpoint.is_finished()) checkpoint.budget.most_iterations += checkpoint.state.iteration;
  }
  // The checkpoint has fixed all settings. Those of reading do not count as set by the user, because the run
  // may be resumed with a packed copy of its data (open_data.cpp).
  for (const Field<TrainSettings>& field : train_fields())
    if (!(field.uses & kOfReading)) settings.chosen.insert(field.key);
  return {{.settings = settings, .fast = {}},
          options.data.empty() ? checkpoint.data : options.data,
          options.resume,
          std::move(lock),
          std::move(checkpoint)};
}

}  // namespace ubs::tools
