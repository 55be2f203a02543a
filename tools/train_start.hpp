// SPDX-License-Identifier: Apache-2.0
// What a training run is made of: from the options of `ubs train`, or from the checkpoint of the run that is
// continued, which must be of the same data, device and settings. `ubs plan` asks here what a new run would
// be.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "host/base/folder_lock.hpp"
#include "host/data/load_dataset.hpp"
#include "host/device/device.hpp"
#include "host/train/checkpoint.hpp"
#include "host/train/fast_settings.hpp"
#include "tools/common/settings_options.hpp"

namespace ubs::tools {

struct StartOptions {
  std::string data, out, resume, budget;  // out empty: beside the data
  bool overwrite = false, any_device = false;
};

struct NewSettings {
  TrainSettings settings;
  // What the settings are made from when the data are known: with --budget, and where nobody chose the
  // iterations.
  std::optional<TrainSettings> fast;
};

struct Start : NewSettings {
  std::string data, out;
  std::unique_ptr<FolderLock> lock;  // of the output folder
  std::optional<Checkpoint> checkpoint;
};

// A folder of that name is not there, or a run that did not begin left it: NAME-ubs beside the data NAME
// (else, where that cannot be written, in the working folder), then NAME-ubs-2, ...
std::filesystem::path free_output_folder(const std::filesystem::path& data);

// Of a new run; N is left to the data where nothing gives it. Throws Error(usage) for a budget that is none,
// or beside iterations.
NewSettings resolve_new(const SettingsOptions& given, const std::string& budget = {});
// `fast`, with what the data have decided since.
TrainSettings fast_base(const NewSettings& run);
std::size_t points_of(const Dataset& data);

// Where nobody chose, a run has this many iterations, which come to what the published ones come to
// (docs/results/2026-11-22-long-schedules.md), or this many seconds, whichever ends first.
inline constexpr int kUnaskedIterations = 16000;
inline constexpr double kUnaskedSeconds = 900;
// The settings of such a run that has all of the iterations.
TrainSettings unasked_settings(const NewSettings& run, const Dataset& data, const PictureFacts& pictures);

// Holds the output folder. N is left to the data where nothing gives it. Throws Error(usage) for options that
// are missing or exclude one another, settings that are not the run's, an output folder that another process
// writes to, or that shares files with the data. `holds`: false for all ranks of a job but the first, which
// leave the folder alone.
Start start_of(const StartOptions& options, const SettingsOptions& settings, bool holds = true);

}  // namespace ubs::tools
