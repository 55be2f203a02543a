// SPDX-License-Identifier: Apache-2.0
// Checkpoint is a training run that is stored on disk. It contains the state of the run and its
// settings, and it identifies the data and the device that are required to resume it. It is a single
// little-endian file with these parts:
//   "UBSCKPT\n", u32 version, u32 bytes of the header, header (JSON: settings, counters, sizes),
//   float32 parameters, first moments, second moments, loss sums, appearance and sky, float64 cameras, u32
//   CRC-32 of everything before.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>

#include "host/cluster/communicator.hpp"
#include "host/scene/dataset.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/time_budget.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

struct Checkpoint {
  TrainState state;
  TrainSettings settings;
  // Settings in the file that only the user may set (kOfUser) and that are therefore not in `settings`: keys
  // and values.
  std::vector<std::pair<std::string, std::string>> unused_settings;
  std::string data;              // absolute path of the data
  std::string data_from_run;     // path of the data relative to the folder of the run; may be empty
  std::uint32_t data_print = 0;  // fingerprint() of the training views
  std::string device, build;     // names; results are bit-identical only with the same device and build
  // Number of views of a batch that each rank renders. Empty unless the run uses several kinds of devices.
  std::vector<std::uint64_t> views_by_rank;
  TimeBudget budget;
  // The first row of log.csv. It contains a time and a loss that identify the run. The text is empty before
  // this row is written.
  std::string first_row;
  bool is_finished() const { return state.iteration == settings.iterations; }
};

// Writes the checkpoint. An existing file is replaced in one step when the new one is complete. Throws
// Error(data) if writing fails, for example because the disk is full, and Error(numerical) if a value of the
// state is not finite. In both cases the old file is unchanged.
// All ranks of an MPI job must call this function together. Each rank passes and writes its own part of the
// splats. An error on one rank is thrown on all ranks. The resulting file does not depend on the number of
// ranks.
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint,
                      Communicator& ranks = alone());

// Reads a checkpoint. Throws Error(data) with the reason if the file is not a checkpoint, has another
// version, is truncated or is damaged.
Checkpoint read_checkpoint(const std::filesystem::path& path);

// Returns a CRC-32 of the names, cameras and image sizes of all views, and of the pixels and masks of the
// first, the middle and the last image.
std::uint32_t fingerprint(const Split& split);

// Throws Error(usage) with the name of the first setting that must not differ but does. Settings with
// kFreeOnResume may differ, because they only affect the measurements and the files that are written, and not
// the training.
void check_same_settings(const TrainSettings& stored, const TrainSettings& wanted);

}  // namespace ubs
