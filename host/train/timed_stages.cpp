// SPDX-License-Identifier: Apache-2.0
#include "host/train/timed_stages.hpp"

namespace ubs {
namespace {

// Iteration kFirst and every kEvery-th iteration after it are sampled. The first iterations are not sampled,
// because kernels are compiled in them.
constexpr int kEvery = 53, kFirst = 29;
constexpr std::size_t kCount = operation_index<CountLists>(), kBuild = operation_index<BuildLists>();

}  // namespace

void TimedStages::begin_iteration(int iteration, bool refines) {
  training_ = true;
  sampling_ = refines || iteration % kEvery == kFirst;
  if (sampling_) device_.finish();
}

void TimedStages::pause() { training_ = sampling_ = false; }

Outcome TimedStages::run(const Operation& operation) {
  if (!training_) return stages_->run(operation);
  if (!sampling_ && std::holds_alternative<Relocate>(operation)) {
    device_.finish();  // wait for earlier operations, so that they are not included in the time
    sampling_ = true;
  }
  StageTotals& account = accounts_[operation.index() == kBuild ? kCount : operation.index()];
  ++account.calls;
  if (!sampling_) return stages_->run(operation);
  const double start = time_.seconds();
  Outcome outcome = stages_->run(operation);
  device_.finish();
  account.seconds += time_.seconds() - start;
  ++account.sampled;
  return outcome;
}

std::vector<StageTime> TimedStages::times() const {
  std::vector<StageTime> times;
  for (std::size_t i = 0; i < accounts_.size(); ++i) {
    const StageTotals& a = accounts_[i];
    if (a.calls == 0) continue;
    const double each = a.sampled > 0 ? a.seconds / static_cast<double>(a.sampled) : 0;
    times.push_back({i == kCount ? "lists" : kOperationNames[i], a.calls, a.sampled,
                     each * static_cast<double>(a.calls)});
  }
  return times;
}

}  // namespace ubs
