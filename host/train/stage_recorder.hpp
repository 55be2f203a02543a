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
  void project_forward(const ProjectForward& a) override {
    note("project_forward", [&] { stages_.project_forward(a); });
  }
  ListTotals count_lists(const CountLists& a) override {
    ListTotals totals;
    note("count_lists", [&] { totals = stages_.count_lists(a); });
    return totals;
  }
  void build_lists(const BuildLists& a) override {
    note("build_lists", [&] { stages_.build_lists(a); });
  }
  void raster_forward(const RasterForward& a) override {
    note("raster_forward", [&] { stages_.raster_forward(a); });
  }
  void image_loss(const ImageLoss& a) override {
    note("image_loss", [&] { stages_.image_loss(a); });
  }
  void raster_backward(const RasterBackward& a) override {
    note("raster_backward", [&] { stages_.raster_backward(a); });
  }
  void sum_slots(const SumSlots& a) override {
    note("sum_slots", [&] { stages_.sum_slots(a); });
  }
  void project_backward(const ProjectBackward& a) override {
    note("project_backward", [&] { stages_.project_backward(a); });
  }
  void regularise(const Regularise& a) override {
    note("regularise", [&] { stages_.regularise(a); });
  }
  void adam(const AdamStep& a) override {
    note("adam", [&] { stages_.adam(a); });
  }
  void learn(const Learn& a) override {
    note("learn", [&] { stages_.learn(a); });
  }
  std::uint32_t relocate(const Relocate& a) override {
    std::uint32_t moved = 0;
    note("relocate", [&] { moved = stages_.relocate(a); });
    return moved;
  }
  void grow(const Grow& a) override {
    note("grow", [&] { stages_.grow(a); });
  }
  void add_noise(const AddNoise& a) override {
    note("add_noise", [&] { stages_.add_noise(a); });
  }

 private:
  template <typename Run>
  void note(const char* stage, const Run& run) {
    log_.note(stage, run);
  }

  StageLog& log_;
  Stages& stages_;
};

}  // namespace ubs
