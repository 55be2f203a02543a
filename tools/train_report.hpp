// SPDX-License-Identifier: Apache-2.0
// These functions make the output of `ubs train` about a run: its start, the final summary and metrics.json.
#pragma once

#include <optional>
#include <string>

#include "host/run/training_run.hpp"
#include "tools/common/output.hpp"
#include "tools/common/run_folder.hpp"
#include "tools/train_start.hpp"

namespace ubs::tools {

struct Evaluation {
  int iteration = 0;
  double seconds = 0;
  Metrics metrics;
};

struct Outcome {
  bool interrupted = false;
  bool saved = true;                     // false if the state of an interrupted run could not be saved
  std::optional<Evaluation> evaluation;  // the last evaluation
  std::optional<Metrics> train;          // some training views, measured with the finished model
};

// Number of training views that are measured at the end of a run, to compare them with the test views.
inline constexpr std::size_t kMeasuredTrainViews = 8;

// Returns a line for the summary if the training views are measured at a much higher PSNR than the test
// views, otherwise nothing.
std::string overfit_text(const Outcome& outcome);

void print_start(const TrainingRun& run, const Device& device);
void print_summary(const Start& start, const RunFolder& folder, Trainer& trainer, const Outcome& outcome,
                   std::uint64_t peak_bytes, std::size_t renders);

// Returns the main part of metrics.json. The caller adds further entries, such as storage_bytes, data_report
// and the times before training. `peak_bytes` is the peak memory of training, and `spent` is the part of
// Trainer::seconds() before the first iteration.
Json run_json(const Start& start, TrainingRun& run, const Device& device, std::uint64_t peak_bytes,
              double spent, const Outcome& outcome);

}  // namespace ubs::tools
