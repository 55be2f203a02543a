// SPDX-License-Identifier: Apache-2.0
// What training does when a parameter, a gradient or the loss is not finite (docs/training.md). The watched
// Adam step (host/device/stages.hpp) notices and does nothing from there on; Guard looks, and answers with
// the state that training goes on from.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/device/device.hpp"
#include "host/scene/splat_model.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/nonfinite_source.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

inline constexpr int kMaxRollbacks = 3;           // of a run
inline constexpr double kMaxDroppedShare = 0.01;  // of the splats, over a run; but always kFewDropped
inline constexpr std::uint64_t kFewDropped = 10;

// A value that is not finite: the iteration that it was found in, where it came from, and all splats with
// such a parameter or moment, ascending.
struct NonFiniteEvent {
  int iteration = 0;
  NonFiniteSource source;
  std::vector<std::uint32_t> splats;
};

// Splats with a parameter or moment that is not finite, ascending.
std::vector<std::uint32_t> splats_not_finite(const TrainState& state);

// Makes the splats dead, that is: finite, nearly transparent and small, where they were when that is known.
// Moments become zero. Relocation finds them and puts them where splats are wanted.
void kill_splats(TrainState& state, const std::vector<std::uint32_t>& splats);

class Guard {
 public:
  Guard(Device& device, OnNan on_nan);

  // For the steps that are watched; an empty view where none is.
  BufferView<std::uint32_t> sentinel() const { return sentinel_.view(); }
  // Called with a message for every event after which training goes on.
  void on_event(std::function<void(const std::string&)> report) { report_ = std::move(report); }

  // After every iteration. `left_out`: it had no gradient.
  void stepped(const TrainProgress& progress, bool left_out);
  // Whether to look now; `before_others`: somebody else is about to read or change the state.
  bool due(int iteration, bool before_others) const;
  // True when all is finite. Otherwise the progress becomes that of the first iteration with a value that is
  // not: the steps since then did nothing. Waits.
  bool look(TrainProgress& progress);

  // What a rollback goes back to.
  bool wants_state() const { return on_nan_ == OnNan::rollback && !good_; }
  void keep(TrainState state);
  // The state was set from outside.
  void restart(const TrainState& state);
  // The state to go on from, of `state` in which the event was found; throws Error(numerical) when training
  // stops. Both messages name iteration, stage, view and splats.
  TrainState answer(const NonFiniteEvent& event, TrainState state, TrainingViews& views);

 private:
  static constexpr std::size_t kLookEvery = 16;  // iterations between looks at the sentinel, at most

  OnNan on_nan_;
  Buffer<std::uint32_t> sentinel_;  // (1): iteration of the first value that is not finite; 0: none
  int looked_ = 0;                  // iteration of the last look
  bool left_out_ = false;           // the last iteration
  std::array<std::uint64_t, kLookEvery + 1> adam_steps_{};  // by iteration modulo its size
  std::optional<TrainState> good_;
  std::function<void(const std::string&)> report_;
};

}  // namespace ubs
