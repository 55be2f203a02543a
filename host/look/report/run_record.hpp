// SPDX-License-Identifier: Apache-2.0
// RunRecord holds the contents of the folder of a training run: settings, log and measurements. read_run()
// also reads incomplete folders as far as possible, for example if the run was killed, if files are missing,
// or if another version of ubs created the folder. `remarks` then lists the missing parts.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "host/base/json.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {

struct RunRecord {
  std::filesystem::path folder;
  std::string name;  // name of the folder
  Json metrics;      // metrics.json; null if it is missing
  // The settings that the run has stored and this version knows, except for those that only the user may set
  // (kOfUser). All other settings have their default values. If the run refined its cameras, run_cameras is
  // the folder that contains them.
  TrainSettings settings;
  // The settings that the run has stored, as texts. Values of settings that this version knows are written as
  // this version writes them, so that equal values have equal texts. Other values are unchanged.
  std::vector<std::pair<std::string, std::string>> setting_texts;
  Json log;                          // log.csv: one array per column, with null for empty fields
  std::vector<std::string> remarks;  // lists missing files and contents that could not be read

  std::filesystem::path model() const { return folder / "model.ply"; }
  std::filesystem::path checkpoint() const { return folder / "checkpoint.ubs"; }
  std::filesystem::path renders() const { return folder / "renders"; }

  // Returns a number of metrics.json by its path, such as {"test", "mean", "psnr"}, or nothing if it is
  // missing.
  std::optional<double> number(const std::vector<std::string>& path) const;
  std::string text(const std::vector<std::string>& path) const;  // "" if it is missing
  std::optional<std::uint32_t> data_print() const;               // fingerprint() of the data
  const Json* find(const std::vector<std::string>& path) const;  // null if it is missing
};

// Reads the folder of a run. Throws Error(data) if `folder` is not a folder, has none of the files of a run,
// or has an invalid metrics.json or config.yaml. Also throws Error(data) if a file of the run is a link to a
// place outside of the folder, unless `allow_outside` is true: pages contain what is in these files.
RunRecord read_run(const std::filesystem::path& folder, bool allow_outside = false);

// Returns the path of a data folder relative to the folder `run`, which runs record in addition to the path
// that the user passed.
std::string data_from_run(const std::filesystem::path& data, const std::filesystem::path& run);
// Returns the possible locations of the data of a run in the folder `run`, whatever the current working
// folder is. `data` is their path as the user passed it, and `from_run` is the result of data_from_run(),
// which stays valid if the run is moved together with its data. `from_run` may be empty, because older runs
// have not recorded it. The base of a relative path `data` is the folder in which training was started, which
// is not recorded; it may be the working folder, or the folder that contains `run`.
std::vector<std::filesystem::path> data_places(const std::string& data, const std::string& from_run,
                                               const std::filesystem::path& run);

// Reads the text of a log.csv. The first line contains the names of the columns, which may be in any order.
// Unknown columns are ignored. Rows with a wrong number of fields, without an iteration, or with fields that
// are not numbers are skipped with a remark. `origin` is the name of the file in remarks. A file without the
// column "iteration" is skipped completely, also with a remark. If training went back to an earlier
// iteration, the later rows replace the earlier ones. Returns an empty object if there are no rows.
Json parse_log(const std::string& csv, const std::string& origin, std::vector<std::string>& remarks);

}  // namespace ubs
