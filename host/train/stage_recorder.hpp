// SPDX-License-Identifier: Apache-2.0
// Stages that note which kernels each operation launches and how long the device worked on them, from the
// device's own clock: profiling must be on.
#pragma once

#include <map>
#include <vector>

#include "host/device/stages.hpp"
#include "host/train/plan.hpp"

namespace ubs {

// What recorders have noted, in the order of the operations. A model of several dimensions has stages, and a
// recorder, for each of its groups: they note into one log.
class StageLog {
 public:
  explicit StageLog(Device& device) : device_(device) {}
  const std::vector<StageUse>& uses() const { return uses_; }

  template <typename Run>
  void note(const char* stage, const Run& run) {
    run();
    StageUse use{stage, {}, 0};
    std::map<std::string, TimerEntry> now;
    for (const TimerEntry& entry : device_.timings()) now[entry.name] = entry;
    for (const auto& [name, entry] : now) {
      const TimerEntry& before = seen_[name];
      if (entry.calls == before.calls) continue;
      use.device_ms += entry.device_ms - before.device_ms;
      if (name != "read" && name != "write" && name != "copy" && name != "fill") use.kernels.push_back(name);
    }
    seen_ = std::move(now);
    uses_.push_back(std::move(use));
  }

 private:
  Device& device_;
  std::map<std::string, TimerEntry> seen_;
  std::vector<StageUse> uses_;
};

class StageRecorder final : public Stages {
 public:
  StageRecorder(StageLog& log, Stages& stages) : log_(log), stages_(stages) {}

  const KernelConfig& config() const override { return stages_.config(); }
  Outcome run(const Operation& operation) override {
    Outcome outcome;
    log_.note(kOperationNames[operation.index()], [&] { outcome = stages_.run(operation); });
    return outcome;
  }

 private:
  StageLog& log_;
  Stages& stages_;
};

}  // namespace ubs
