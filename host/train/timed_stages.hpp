// SPDX-License-Identifier: Apache-2.0
// Stages that pass every call on and, in sampled iterations, wait after each one and take the time: where a
// training's minutes go, on any back end, without profiling. Results do not change. A sampled iteration pays
// a wait for each of about ten calls (30 to 60 us each on PoCL, less on GPUs); with one iteration in 53
// sampled that is below 0.02 ms an iteration.
#pragma once

#include <array>
#include <memory>
#include <string_view>
#include <vector>

#include "host/base/time_source.hpp"
#include "host/device/stages.hpp"

namespace ubs {

struct StageTime {
  std::string_view stage;  // of kOperationNames; "lists" is count and build
  std::uint64_t calls = 0, sampled = 0;
  double seconds = 0;  // estimate for all calls: mean of the sampled ones times calls
};

class TimedStages final : public Stages {
 public:
  TimedStages(Device& device, std::unique_ptr<Stages> stages, const TimeSource& time)
      : device_(device), stages_(std::move(stages)), time_(time) {}

  // At the start of every iteration: samples each 53rd (a prime, so that it meets all views and does not keep
  // step with refinement), and from its start an iteration that `refines`, which has
  // stages of its own (else from its relocation on).
  void begin_iteration(int iteration, bool refines);
  // Ends sampling: evaluations are not training.
  void pause();
  // Stages that were called in training; those never sampled (short runs) have 0 seconds.
  std::vector<StageTime> times() const;

  const KernelConfig& config() const override { return stages_->config(); }
  Outcome run(const Operation& operation) override;

 private:
  struct Account {
    std::uint64_t calls = 0, sampled = 0;
    double seconds = 0;  // of the sampled calls
  };

  Device& device_;
  std::unique_ptr<Stages> stages_;
  const TimeSource& time_;
  bool training_ = false, sampling_ = false;
  std::array<Account, kOperationNames.size()> accounts_;
};

}  // namespace ubs
