// SPDX-License-Identifier: Apache-2.0
// Start contains the inputs of a training run: settings, data and output folder. It is made from the options
// of `ubs train`, or from the checkpoint of a run that is resumed. The options must then agree with the data,
// the device (except with --any-device) and the settings of that run.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "host/base/folder_lock.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/device/device.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/checkpoint.hpp"
#include "tools/common/settings_options.hpp"

namespace ubs::tools {

struct StartOptions {
  std::string data, out, resume;  // out empty: a folder next to the data
  bool overwrite = false, any_device = false;
};

struct Start {
  TrainSettings settings;  // as asked for; those of the checkpoint if a run is resumed
  std::string data, out;
  std::unique_ptr<FolderLock> lock;  // lock of the output folder
  std::optional<Checkpoint> checkpoint;
  bool has_more_time = false;  // the resumed run gets another budget
};

// Throws an error with an explanation if the extension shows that the file is an image or a video.
void refuse_pictures(const std::filesystem::path& file);

// Returns the first free output folder: NAME-ubs next to the data NAME (in the working folder if that is not
// writable), then NAME-ubs-2, and so on. A folder is free if it does not exist or was left by a run that
// ended before its first step.
std::filesystem::path free_output_folder(const std::filesystem::path& data);

// Collects the inputs of a run and locks the output folder. If N is not given, the data determine it later.
// Throws Error(usage) for missing or conflicting options, for settings that differ from those of the run, and
// for an output folder that another process writes to or that shares files with the data. `holds`: true for
// the first rank of a job. For the other ranks it is false, and they do not touch the folder.
Start start_of(const StartOptions& options, const SettingsOptions& settings, bool holds = true);

}  // namespace ubs::tools
