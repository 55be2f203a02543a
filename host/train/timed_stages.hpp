// SPDX-License-Identifier: Apache-2.0
// TimedStages passes every call on to other stages and measures its time in sampled iterations, in which it
// waits after each call. This shows on any back end how the time of a training is distributed, without
// profiling. Results do not change. A sampled iteration pays for a wait after each of about ten calls (30 to
// 60 us each on PoCL, less on GPUs). Since one iteration in 53 is sampled, this is less than 0.02 ms per
// iteration.
#pragma once

#include <array>
#include <memory>
#include <string_view>
#include <vector>

#include "host/base/time_source.hpp"
#include "host/device/stages.hpp"

namespace ubs {

struct StageTime {
  std::string_view stage;  // one of kOperationNames; "lists": count_lists and build_lists together
  std::uint64_t calls = 0, sampled = 0;
  double seconds = 0;  // estimate for all calls: mean of the sampled calls times `calls`
};

class TimedStages final : public Stages {
 public:
  TimedStages(Device& device, std::unique_ptr<Stages> stages, const TimeSource& time)
      : device_(device), stages_(std::move(stages)), time_(time) {}

  // Must be called at the start of every iteration. Samples every 53rd iteration (a prime, so that in time
  // all views are sampled and the samples do not coincide with refinements), and every iteration that
  // `refines`, because such an iteration has stages of its own. If `refines` is false for an iteration that
  // relocates, sampling starts at its relocation.
  void begin_iteration(int iteration, bool refines);
  // Ends sampling until the next iteration, because evaluations are not part of training.
  void pause();
  // Returns the times of the stages that were called in training. Stages that were never sampled (in short
  // runs) have 0 seconds.
  std::vector<StageTime> times() const;

  const KernelConfig& config() const override { return stages_->config(); }
  Outcome run(const Operation& operation) override;

 private:
  struct Account {
    std::uint64_t calls = 0, sampled = 0;
    double seconds = 0;  // time of the sampled calls
  };

  Device& device_;
  std::unique_ptr<Stages> stages_;
  const TimeSource& time_;
  bool training_ = false, sampling_ = false;
  std::array<Account, kOperationNames.size()> accounts_;
};

}  // namespace ubs
