// SPDX-License-Identifier: Apache-2.0
// RunKeeper writes the checkpoints of a training run to disk.
#pragma once

#include <filesystem>

#include "host/train/checkpoint.hpp"
#include "tools/common/run_folder.hpp"

namespace ubs::tools {

// Opens the checkpoint in the folder of an unfinished run, or of a run that was completed early. With
// `more_time`, also opens continue.ubs of a finished run. Throws Error(usage) if the run is finished and
// either `more_time` is false or there is no continue.ubs. Throws Error(data) if the folder of an unfinished
// run has no checkpoint, if the checkpoint cannot be read, or if it belongs to another run.
Checkpoint open_checkpoint(const std::filesystem::path& folder, bool more_time);

class RunKeeper {
 public:
  // `run`: the checkpoint without its state. `saved`: iteration of the existing checkpoint, or -1.
  RunKeeper(RunFolder& folder, Checkpoint run, int saved);

  // Writes a checkpoint. Must be called by all ranks; each writes its part. If writing fails (disk full),
  // warns: training continues, the previous checkpoint is kept, and the next one is tried at its regular
  // time. Returns whether the checkpoint was written.
  // `settings`: those of the run, including changes by a time budget.
  bool save(const TrainState& state, const TrainSettings& settings);
  // Returns the iteration of the last checkpoint; -1 if there is none yet.
  int saved_iteration() const { return saved_; }

 private:
  RunFolder& folder_;
  Checkpoint run_;
  int saved_;
};

}  // namespace ubs::tools
