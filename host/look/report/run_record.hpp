// SPDX-License-Identifier: Apache-2.0
// What the folder of a training run says about it: settings, log, measurements. Lenient: runs that were
// killed, that an older or newer version made, or of which files were deleted are read as far as they go, and
// what is missing is told.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "host/base/json.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

struct RunRecord {
  std::filesystem::path folder;
  std::string name;        // of the folder
  Json metrics;            // metrics.json; null without
  TrainSettings settings;  // as far as they are known to this version, else the defaults; with run_cameras
  std::vector<std::pair<std::string, std::string>> setting_texts;  // as the run has them, also unknown ones
  Json log;  // of log.csv: an array for each column, with null where the field is empty
  std::vector<std::string> remarks;  // what is missing or could not be read

  std::filesystem::path model() const { return folder / "model.ply"; }
  std::filesystem::path checkpoint() const { return folder / "checkpoint.ubs"; }
  std::filesystem::path renders() const { return folder / "renders"; }

  // A number of metrics.json by its path, such as {"test", "mean", "psnr"}; nothing where there is none.
  std::optional<double> number(const std::vector<std::string>& path) const;
  std::string text(const std::vector<std::string>& path) const;  // "" where there is none
  const Json* find(const std::vector<std::string>& path) const;
};

// Throws Error(data) where `folder` is no folder, has none of the files of a run, or has a metrics.json that
// is no JSON.
RunRecord read_run(const std::filesystem::path& folder);

// Where the data folder that a run names can be: a relative path is relative to where training was started,
// the working folder or the one that the run is in.
std::vector<std::filesystem::path> data_places(const std::string& data, const std::filesystem::path& run);

// Reads the columns that the head names, in any order. Rows with fields that are not numbers are left out
// with a remark, and so is a file without the column "iteration". Where training went back to an earlier
// iteration, the later rows count. Returns an empty object where there is no row.
Json parse_log(const std::string& csv, const std::string& origin, std::vector<std::string>& remarks);

}  // namespace ubs
