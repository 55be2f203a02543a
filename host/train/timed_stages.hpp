// SPDX-License-Identifier: Apache-2.0
// TimedStages forwards every call to other stages. In some iterations, the samples, it also waits for the
// device after each call and measures the time of the call. This shows with any back end how the training
// time is distributed over the operations, without profiling and without any effect on the results. A sampled
// iteration has about ten calls. Each wait takes 30 to 60 us on PoCL, and less on GPUs. Because one iteration
// in 53 is sampled, this is less than 0.02 ms per iteration on average.
#pragma once

#include <array>
#include <memory>
#include <string_view>
#include <vector>

#include "host/base/time_source.hpp"
#include "host/device/stages.hpp"

namespace ubs {

// StageTime is the estimated time of one operation in the whole training.
struct StageTime {
  // One of kOperationNames, or "lists" for count_lists and build_lists together.
  std::string_view stage;
  std::uint64_t calls = 0, sampled = 0;  // number of all calls, and of measured calls
  double seconds = 0;                    // mean time of the measured calls, multiplied by `calls`
};

class TimedStages final : public Stages {
 public:
  TimedStages(Device& device, std::unique_ptr<Stages> stages, const TimeSource& time)
      : device_(device), stages_(std::move(stages)), time_(time) {}

  // Must be called at the start of every iteration. Every 53rd iteration is sampled. 53 is a prime number, so
  // that all views are sampled in the course of a training run, and samples rarely coincide with refinements.
  // Iterations with `refines` are sampled too, because they have additional operations. If an iteration
  // relocates splats although `refines` is false, sampling starts at the relocation.
  void begin_iteration(int iteration, bool refines);
  // Stops counting and sampling until the next iteration. Must be called before an evaluation, which is not
  // part of the training.
  void pause();
  // Returns the times of the operations that were called during training. Operations that were never sampled,
  // which can happen in short runs, have 0 seconds.
  std::vector<StageTime> times() const;

  const KernelConfig& config() const override { return stages_->config(); }
  Outcome run(const Operation& operation) override;

 private:
  struct StageTotals {
    std::uint64_t calls = 0, sampled = 0;
    double seconds = 0;  // time of the sampled calls
  };

  Device& device_;
  std::unique_ptr<Stages> stages_;
  const TimeSource& time_;
  bool training_ = false, sampling_ = false;
  std::array<StageTotals, kOperationNames.size()> accounts_;
};

}  // namespace ubs
