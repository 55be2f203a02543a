// SPDX-License-Identifier: Apache-2.0
// Keeps a training run on disk: its checkpoints.
#pragma once

#include <filesystem>

#include "host/train/checkpoint.hpp"
#include "tools/common/run_folder.hpp"

namespace ubs::tools {

// The checkpoint in the folder of a run that was not finished. Throws Error(usage) when the run is finished,
// Error(data) when there is no checkpoint, it cannot be read, or it is that of another run.
Checkpoint open_checkpoint(const std::filesystem::path& folder);

class RunKeeper {
 public:
  // `run`: all of the checkpoint but its state. `saved`: iteration of the checkpoint that is there, or -1.
  RunKeeper(RunFolder& folder, Checkpoint run, int saved);

  // All ranks, each with its part. A checkpoint that cannot be written (disk full) is a warning: training
  // goes on, the one before stays, and the next one is tried when its time comes. Returns whether it was
  // written.
  // `settings`: of the run, as a time budget has them by now.
  bool save(const TrainState& state, const TrainSettings& settings);
  // Iteration of the last checkpoint; -1: none yet.
  int saved_iteration() const { return saved_; }

 private:
  RunFolder& folder_;
  Checkpoint run_;
  int saved_;
};

}  // namespace ubs::tools
