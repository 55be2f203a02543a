// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/plan.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/data/data_root.hpp"

namespace ubs::experiment {
namespace {

namespace fs = std::filesystem;

// Names of scenes may be given bare where only one data set of the experiment has them: "lego" is a static
// scene in one set and a moving one in another, and taking one for the other would be silent nonsense.
class SceneNames {
 public:
  explicit SceneNames(const ExperimentSpec& spec) {
    for (const DataEntry& entry : spec.data)
      for (const std::string& scene : entry.scenes) {
        known_.push_back(entry.set.name + "/" + scene);
        by_scene_[scene].push_back(known_.back());
      }
  }

  // "set/scene" of what the user wrote.
  std::string resolve(const std::string& name, const char* option) const {
    if (std::ranges::find(known_, name) != known_.end()) return name;
    const auto found = by_scene_.find(name);
    if (found == by_scene_.end()) {
      std::vector<std::string> words = known_;
      for (const auto& [scene, sets] : by_scene_) words.push_back(scene);
      const std::string nearest = nearest_word(name, words);
      fail(ErrorKind::usage, "{}: the experiment has no scene '{}'; {}", option, name,
           nearest.empty() ? fmt::format("there are: {}", fmt::join(known_, ", "))
                           : fmt::format("did you mean '{}'?", nearest));
    }
    if (found->second.size() > 1)
      fail(ErrorKind::usage, "{}: scene '{}' is in several data sets: write one of {}", option, name,
           fmt::join(found->second, ", "));
    return found->second.front();
  }
  bool unique(const std::string& scene) const { return by_scene_.at(scene).size() == 1; }

 private:
  std::vector<std::string> known_;
  std::map<std::string, std::vector<std::string>> by_scene_;
};

// <root>/<set>/<scene>, then <root>/<scene>; or a packed file of that name with the suffix .ubsd.
void find_data(const PlanOptions& options, const DataSetSpec& set, const SceneSpec& scene, bool unique,
               const std::string* given, Job& job) {
  std::vector<fs::path> candidates;
  const auto add = [&](const fs::path& path) {
    candidates.push_back(path);
    candidates.push_back(fs::path(path).concat(".ubsd"));
  };
  if (given) {
    candidates.push_back(options.root / *given);  // an absolute one stays what it is
  } else {
    for (const std::string& folder : set.folders)
      for (const std::string& name : scene.folders) add(options.root / folder / name);
    if (unique)
      for (const std::string& name : scene.folders) add(options.root / name);
  }
  for (const fs::path& candidate : candidates) {
    if (path_exists(candidate)) {
      job.data = candidate;
      return;
    }
  }
  job.looked_for = given
                       ? candidates.front().string()
                       : fmt::format(fmt::runtime(unique ? "{}/[{}/]{}" : "{}/{}/{}"), options.root.string(),
                                     fmt::join(set.folders, "|"), fmt::join(scene.folders, "|"));
}

TrainSettings published_settings(const ExperimentSpec& spec, const RowSpec& row, const DataEntry& entry,
                                 const SceneSpec& scene) {
  TrainSettings settings;
  const auto fields = bind_fields(settings, train_fields());
  for (const auto* part :
       {&entry.set.settings, &scene.settings, &spec.settings, &entry.settings, &row.settings})
    set_fields(fields, *part);
  return settings;
}

int divided(int value, int divisor) {
  return std::max(1, static_cast<int>(std::lround(1.0 * value / divisor)));
}

// Splats go with the area of images, so that the splats a pixel stay; the schedule scales with the
// iterations.
void scale_down(TrainSettings& settings, int k) {
  settings.cap_max = divided(settings.cap_max, k * k);
  if (settings.init_points != kAutoInt) settings.init_points = divided(settings.init_points, k * k);
  settings.iterations = divided(settings.iterations, k);
}

// Images that are smaller than published already are reduced by less; never enlarged.
void scale_images(TrainSettings& settings, int k, const std::optional<int>& published_width, int full_width) {
  if (!published_width) {
    settings.downscale = std::min(64, settings.downscale * k);
    return;
  }
  settings.downscale =
      std::clamp(static_cast<int>(std::lround(1.0 * full_width * k / *published_width)), 1, 64);
}

// `named`: the user has said where the data are.
void finish(Job& job, const PlanOptions& options, bool named, const ImageWidth& image_width) {
  const bool scaled = options.scale_down > 1;
  try {
    TrainSettings assigned = job.settings;
    set_fields(bind_fields(assigned, train_fields()), options.assignments);
    if (!named) DataRoot(options.root, assigned.allow_outside).check(job.data);
    if (scaled) scale_down(job.settings, options.scale_down);
    if (scaled && !job.data.empty()) {
      TrainSettings full = job.settings;
      full.downscale = 1;
      scale_images(job.settings, options.scale_down, job.published_width, image_width(job.data, full));
    }
    set_fields(bind_fields(job.settings, train_fields()), options.assignments);
    validate(job.settings);
    if (!job.data.empty()) job.width = image_width(job.data, job.settings);
  } catch (const Error& error) {
    job.problem = error.what();
    job.problem_code = exit_code(error.kind());
  }
}

void check_names(const ExperimentSpec& spec, const PlanOptions& options) {
  for (const std::string& row : options.rows)
    if (std::ranges::find(spec.rows, row, &RowSpec::name) == spec.rows.end()) {
      std::vector<std::string> names;
      for (const RowSpec& known : spec.rows) names.push_back(known.name);
      fail(ErrorKind::usage, "--rows: the experiment has no row '{}'; there are: {}", row,
           fmt::join(names, ", "));
    }
  if (!is_folder(options.root))
    fail(ErrorKind::data, "{}: no such folder; --root names the one that holds the data sets",
         options.root.string());
  TrainSettings scratch;  // mistakes in --set are the user's, not those of a job
  set_fields(bind_fields(scratch, train_fields()), options.assignments);
}

}  // namespace

std::string Job::folder_name() const {
  std::string name = id;
  std::ranges::replace(name, '/', '.');
  return name;
}

std::vector<Job> make_plan(const ExperimentSpec& spec, const PlanOptions& options,
                           const ImageWidth& image_width) {
  check_names(spec, options);
  const SceneNames names(spec);
  std::set<std::string> wanted;
  for (const std::string& scene : options.scenes) wanted.insert(names.resolve(scene, "--scenes"));
  std::map<std::string, std::string> folders;
  for (const auto& [scene, folder] : options.scene_folders)
    folders[names.resolve(scene, "--scene-folder")] = folder;

  std::vector<Job> jobs;
  for (std::size_t r = 0; r < spec.rows.size(); ++r) {
    const RowSpec& row = spec.rows[r];
    if (!options.rows.empty() && std::ranges::find(options.rows, row.name) == options.rows.end()) continue;
    for (std::size_t d = 0; d < spec.data.size(); ++d) {
      const DataEntry& entry = spec.data[d];
      for (const std::string& name : entry.scenes) {
        const std::string place = entry.set.name + "/" + name;
        if (!wanted.empty() && !wanted.contains(place)) continue;
        const SceneSpec& scene = *entry.set.find(name);
        Job& job = jobs.emplace_back();
        job.id = row.name + "/" + place;
        job.row = r;
        job.set = d;
        job.scene = name;
        job.published_width = scene.width;
        const auto given = folders.find(place);
        find_data(options, entry.set, scene, names.unique(name),
                  given == folders.end() ? nullptr : &given->second, job);
        job.published = job.settings = published_settings(spec, row, entry, scene);
        finish(job, options, given != folders.end(), image_width);
      }
    }
  }
  return jobs;
}

bool decides_result(std::string_view key) {
  static const std::set<std::string_view> kOthers{"image_cache_mb", "cache_folder", "eval_every",
                                                  "save_renders",   "log_every",    "checkpoint_every",
                                                  "allow_outside"};
  return !kOthers.contains(key);
}

std::vector<std::string> changed_settings(const TrainSettings& from, const TrainSettings& to) {
  TrainSettings a = from, b = to;
  const auto before = bind_fields(a, train_fields()), after = bind_fields(b, train_fields());
  std::vector<std::string> changes;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const std::string old = field_text(before[i]), now = field_text(after[i]);
    if (old != now && decides_result(before[i].key))
      changes.push_back(fmt::format("{} {} -> {}", before[i].key, old, now));
  }
  return changes;
}

}  // namespace ubs::experiment
