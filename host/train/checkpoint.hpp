// SPDX-License-Identifier: Apache-2.0
// Checkpoint is a training run on disk: its state, and the settings, data and device that it must be
// continued with. It is one little-endian file:
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
#include "host/scene/train_settings.hpp"
#include "host/train/time_budget.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

struct Checkpoint {
  TrainState state;
  TrainSettings settings;
  std::string data;              // absolute path
  std::uint32_t data_print = 0;  // fingerprint() of the training views
  std::string device, build;     // results depend on both
  // Only for runs on several kinds of devices: how many views of a batch each rank renders.
  std::vector<std::uint64_t> views_by_rank;
  TimeBudget budget;
  // The first row of log.csv. Its seconds and loss identify the run. The text is empty before the row exists.
  std::string first_row;
  bool is_finished() const { return state.iteration == settings.iterations; }
};

// Writes the checkpoint and replaces an existing file in one step: the old file stays until the new one is
// complete. Throws Error(data) if the disk is full, and Error(numerical) if a value of the state is not
// finite; the old file is then unchanged.
// All ranks of a job call this together. Each rank passes its part of the splats and writes it itself. An
// error on one rank is thrown on all ranks. The resulting file does not depend on the number of ranks.
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint,
                      Communicator& ranks = alone());

// Reads a checkpoint. Throws Error(data) with the reason if the file is not a checkpoint, has another
// version, is truncated or is damaged.
Checkpoint read_checkpoint(const std::filesystem::path& path);

// Returns a CRC-32 of the names, cameras and image sizes of all views, and of the pixels of the first, the
// middle and the last image.
std::uint32_t fingerprint(const Split& split);

// Throws Error(usage) with the name of the first setting that differs although it must not. Settings with
// kFreeOnResume may differ, because they affect what is measured and stored, not what is trained.
void check_same_settings(const TrainSettings& stored, const TrainSettings& wanted);

}  // namespace ubs
