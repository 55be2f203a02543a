// SPDX-License-Identifier: Apache-2.0
// From an experiment to a list of training runs: which data are there, and the settings of each run as
// published and as they will be used. Later wins: defaults < data set < scene < experiment < its data entry <
// row < scaling down < assignments of the caller. Planning reads headers of data at most and writes nothing.
#pragma once

#include <functional>

#include "host/experiment/experiment_spec.hpp"
#include "host/spec/train_settings.hpp"

namespace ubs::experiment {

struct PlanOptions {
  std::filesystem::path root;
  std::vector<std::string> scenes, rows;             // names ("lego", "dnerf/lego"); empty: all
  std::map<std::string, std::string> scene_folders;  // scene or set/scene -> folder, relative to root
  int scale_down = 1;                                // K: images / K, splats / K^2, iterations / K
  std::vector<Assignment> assignments;
};

struct Job {
  std::string id;       // row/set/scene
  std::size_t row = 0;  // of the specification
  std::size_t set = 0;  // likewise, index into data
  std::string scene;
  std::filesystem::path data;                 // empty: not found
  std::string looked_for;                     // where it was looked for
  std::string problem;                        // why it cannot run: settings that do not fit, unusable data
  int problem_code = 0;                       // its exit code
  std::optional<int> width, published_width;  // of the images as they will be used, and as published [px]
  TrainSettings published, settings;

  bool runnable() const { return !data.empty() && problem.empty(); }
  std::string folder_name() const;  // of its results
};

// Width of the images of a data folder with these settings; may throw Error.
using ImageWidth = std::function<int(const std::filesystem::path&, const TrainSettings&)>;

// In the order of the file: rows, then data sets, then scenes. Unknown names are Error(usage).
std::vector<Job> make_plan(const ExperimentSpec& spec, const PlanOptions& options,
                           const ImageWidth& image_width);

// Settings that differ: "iterations 30000 -> 2000"; those that cannot change a result are left out.
std::vector<std::string> changed_settings(const TrainSettings& from, const TrainSettings& to);

// Fields that change what is kept or shown, but not the model that is learned or its measurements.
bool decides_result(std::string_view key);

}  // namespace ubs::experiment
