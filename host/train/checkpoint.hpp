// SPDX-License-Identifier: Apache-2.0
// A training run on disk: its state, and what it must be continued with. One file, little-endian:
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
  std::string data;              // path, absolute
  std::uint32_t data_print = 0;  // fingerprint() of the training views
  std::string device, build;     // results depend on both
  // Of ranks with several kinds of devices: how many views of a batch each one draws.
  std::vector<std::uint64_t> views_by_rank;
  TimeBudget budget;
  std::string first_row;  // of log.csv, whose seconds and loss no other run has; empty before there is one
};

// Replaces the file in one step: what was there stays until the new one is complete. Throws Error(data) when
// the disk is full, Error(numerical) when a value of the state is not finite; the old file is then untouched.
// All ranks of a job, each with its part of the splats, which it writes itself; an error is one of all.
// Whoever reads it does not see how many they were.
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint,
                      Communicator& ranks = alone());

// Throws Error(data) that says what is wrong with the file: not one of ours, of another version, truncated,
// damaged.
Checkpoint read_checkpoint(const std::filesystem::path& path);

// CRC-32 of names, cameras and image sizes of all views and of the pixels of the first, the middle and the
// last.
std::uint32_t fingerprint(const Split& split);

// Throws Error(usage) naming the first setting that differs and may not (kFreeOnResume: what is measured and
// kept, not what is learnt).
void check_same_settings(const TrainSettings& stored, const TrainSettings& wanted);

}  // namespace ubs
