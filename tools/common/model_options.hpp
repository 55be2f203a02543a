// SPDX-License-Identifier: Apache-2.0
// ModelOptions has the options that are common to all commands for rendering a model
// (host/model/model_session.hpp), such as render, eval and gradients.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>

#include "host/formats/splat_file.hpp"
#include "host/model/model_session.hpp"
#include "host/run/open_data.hpp"
#include "host/settings/train_settings.hpp"
#include "tools/common/settings_options.hpp"

namespace ubs::tools {

// ModelOptions holds the options --model (or the first argument), --data, --split and --device, and the
// settings for rendering.
struct ModelOptions {
  ModelOptions(CLI::App& app, std::vector<std::string_view> keys);

  std::string model, data, split = "test", device;
  SettingsOptions settings;
  bool split_given() const { return split_option_->count() > 0; }
  // Loads the model after checking the options.
  LoadedModel load() const;

 private:
  CLI::Option* split_option_ = nullptr;
};

void add_device_option(CLI::App& app, std::string& device);
// Returns the model file in a folder (find_splat_model()). If the folder is the output of another trainer,
// prints a line that says which of its files is used.
std::filesystem::path model_in_folder(const std::filesystem::path& folder);

inline constexpr const char* kRunDataHelp =
    "data folder or packed file [the data that the run was trained on]";
inline constexpr const char* kModelHelp =
    "model of any format (docs/data.md), or output folder of 'ubs train'";
// Adds the option for the model of a command. The user may pass a file, or the output folder of a run; then
// the model in that folder is used.
CLI::Option* add_model_option(CLI::App& app, const std::string& name, std::string& model,
                              const std::string& help = kModelHelp);

// RunData describes the data that a run was trained on. Its members are empty if there is no run, or if the
// run was trained on other data.
struct RunData {
  // Settings of the run, which determine how it read the data (downscale, test_every, ...).
  std::optional<TrainSettings> settings;
  // The opened data, if they had to be opened to compare them with those of the run.
  std::optional<OpenedData> opened;
};

// Finds the data that the run of this model was trained on. If `data` is empty, it is set to their path.
// Otherwise `data` may name the same data or a copy; the result is empty for any other data. If `data` is
// empty, throws Error(usage) for a model outside of a run folder, and Error(data) if the data are missing or
// have changed, or if the run has no fingerprint of its data. `given` are the settings of the user, of which
// those with kOfUser are used: the files of the run cannot set them.
RunData use_run_data(const std::string& model, std::string& data, const TrainSettings& given);

// If there is a run, makes `settings` read the data as the run did.
void read_as(TrainSettings& settings, const RunData& run);

// Returns the settings for rendering that the model states, unless `options` override them. Deviations from
// the model are printed to stderr.
TrainSettings drawing_settings(const SettingsOptions& options, const LoadedModel& model,
                               const std::string& path, const RunData& run = {});

}  // namespace ubs::tools
