// SPDX-License-Identifier: Apache-2.0
// The options of commands that draw a model (host/api/model_session.hpp): what render, eval and gradients
// have in common.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>

#include "host/api/model_session.hpp"
#include "host/api/open_data.hpp"
#include "host/data/splat_file.hpp"
#include "host/scene/train_settings.hpp"
#include "tools/common/settings_options.hpp"

namespace ubs::tools {

// Options --model (or the first argument), --data, --split, --device and the settings that decide how a model
// is drawn.
struct ModelOptions {
  ModelOptions(CLI::App& app, std::vector<std::string_view> keys);

  std::string model, data, split = "test", device;
  SettingsOptions settings;
  bool split_given() const { return split_option_->count() > 0; }
  // The model, once the options have been found to make sense.
  LoadedModel load() const;

 private:
  CLI::Option* split_option_ = nullptr;
};

void add_device_option(CLI::App& app, std::string& device);

inline constexpr const char* kRunDataHelp =
    "data folder or packed file [the data that the run was trained on]";
inline constexpr const char* kModelHelp =
    "model of any format (docs/data.md), or output folder of 'ubs train'";
// The model of a command: a file, or the output folder of a run for the model in it.
CLI::Option* add_model_option(CLI::App& app, const std::string& name, std::string& model,
                              const std::string& help = kModelHelp);

// The data that a run was trained on; empty if there is no run, or if it was trained on other data.
struct RunData {
  std::optional<TrainSettings> settings;  // of the run: how it read them (downscale, test_every, ...)
  std::optional<OpenedData> opened;       // they were opened to compare them with those of the run
};

// Finds the data that the run of this model was trained on. If `data` is empty, it is set to their path.
// Otherwise `data` may be the same data or a copy of them, and the result is empty if it is neither. Without
// named data it throws Error(usage) for a model outside of a run's folder, and Error(data) if the data are
// gone or have changed.
RunData use_run_data(const std::string& model, std::string& data);

// `settings` read data as the run did, if there is one.
void read_as(TrainSettings& settings, const RunData& run);

// As the model says that it wants to be drawn, unless `options` say otherwise, which goes to stderr.
TrainSettings drawing_settings(const SettingsOptions& options, const LoadedModel& model,
                               const std::string& path, const RunData& run = {});

}  // namespace ubs::tools
