// SPDX-License-Identifier: Apache-2.0
// RunWriter writes the checkpoints of a training run to disk.
#pragma once

#include <filesystem>
#include <functional>

#include "host/train/checkpoint.hpp"
#include "tools/common/run_folder.hpp"

namespace ubs::tools {

// Opens the checkpoint in the folder of an unfinished run, or of a run that was completed early. With
// `more_time`, also opens continue.ubs of a finished run. Throws Error(usage) if the run is finished and
// either `more_time` is false or there is no continue.ubs, or if the results in the folder are of a later
// iteration than the checkpoint. Throws Error(data) if the folder of an unfinished
// run has no checkpoint, if the checkpoint cannot be read, or if it belongs to another run.
Checkpoint open_checkpoint(const std::filesystem::path& folder, bool more_time);

class RunWriter {
 public:
  // `run`: the checkpoint without its state. `saved`: iteration of the existing checkpoint, or -1.
  RunWriter(RunFolder& folder, Checkpoint run, int saved);

  // Writes a checkpoint. Must be called by all ranks; each writes its part. If this fails (disk full, out of
  // memory), warns: training continues, the previous checkpoint is kept, and the next one is tried at its
  // regular time. Returns whether the checkpoint was written. Throws Error(data) if the folder was removed
  // or replaced.
  // `settings`: those of the run, including changes by a time budget.
  bool save(const TrainState& state, const TrainSettings& settings);
  bool save(const Trainer& trainer, const TrainSettings& settings);
  // Is the last step of a finished run, whose results are of `iteration`. Renames the checkpoint to
  // continue.ubs if it is of this iteration. An older one is removed: a run that is continued from it would
  // replace the results by older ones.
  void finish(int iteration);
  // Returns the iteration of the last checkpoint; -1 if there is none yet.
  int saved_iteration() const { return saved_; }

 private:
  bool save(int iteration, const TrainSettings& settings, const std::function<void()>& take_state);

  RunFolder& folder_;
  Checkpoint run_;
  int saved_;
};

}  // namespace ubs::tools
