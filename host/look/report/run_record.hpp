// SPDX-License-Identifier: Apache-2.0
// RunRecord holds what the folder of a training run contains: settings, log, measurements. read_run() also
// reads runs that were killed, were made by an older or newer version or lack files, as far as possible, and
// reports what is missing.
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
  std::string name;  // name of the folder
  Json metrics;      // metrics.json; null if it is missing
  // The settings that this version knows; all others have their default values. Includes run_cameras.
  TrainSettings settings;
  // The settings as texts, as the run has stored them, including settings that this version does not know.
  std::vector<std::pair<std::string, std::string>> setting_texts;
  Json log;                          // log.csv: one array per column, with null for empty fields
  std::vector<std::string> remarks;  // what is missing or could not be read

  std::filesystem::path model() const { return folder / "model.ply"; }
  std::filesystem::path checkpoint() const { return folder / "checkpoint.ubs"; }
  std::filesystem::path renders() const { return folder / "renders"; }

  // Returns a number of metrics.json by its path, such as {"test", "mean", "psnr"}, or nothing if it is
  // missing.
  std::optional<double> number(const std::vector<std::string>& path) const;
  std::string text(const std::vector<std::string>& path) const;  // "" if it is missing
  const Json* find(const std::vector<std::string>& path) const;
};

// Throws Error(data) if `folder` is not a folder, has none of the files of a run, or has an invalid
// metrics.json.
RunRecord read_run(const std::filesystem::path& folder);

// Returns the possible locations of the data folder that a run has recorded. A relative path is relative to
// the folder in which training was started, to the working folder, or to the folder that contains the run.
std::vector<std::filesystem::path> data_places(const std::string& data, const std::filesystem::path& run);

// Reads the columns that the first line names, in any order. Rows with fields that are not numbers are
// skipped with a remark, and so is a file without the column "iteration". If training went back to an earlier
// iteration, the later rows replace the earlier ones. Returns an empty object if there are no rows.
Json parse_log(const std::string& csv, const std::string& origin, std::vector<std::string>& remarks);

}  // namespace ubs
