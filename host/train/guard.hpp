// SPDX-License-Identifier: Apache-2.0
// Guard decides how training continues when a parameter, a gradient or the loss is not finite
// (docs/training.md). The watched Adam step (host/device/stages.hpp) records the first iteration with such a
// value and changes nothing afterwards. Guard reads this record at intervals and returns the state from which
// training continues.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/device/device.hpp"
#include "host/scene/splat_model.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/nonfinite_source.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

inline constexpr int kMaxRollbacks = 3;  // maximum number of rollbacks in a run
// Maximum share of the splats that may be dropped in a run; kFewDropped splats are always allowed.
inline constexpr double kMaxDroppedShare = 0.01;
inline constexpr std::uint64_t kFewDropped = 10;

// NonFiniteEvent describes an iteration in which values are not finite: the number of the iteration, the
// source of the values, and all splats that have such a parameter or moment, in ascending order.
struct NonFiniteEvent {
  int iteration = 0;
  NonFiniteSource source;
  std::vector<std::uint32_t> splats;
};

// Returns the splats that have a parameter or moment that is not finite, in ascending order.
std::vector<std::uint32_t> splats_not_finite(const TrainState& state);

// Makes the splats dead: their parameters become finite, nearly transparent and small. They keep their
// positions if these are finite. Their moments become zero. The next relocation moves dead splats to places
// where splats are needed.
void kill_splats(TrainState& state, const std::vector<std::uint32_t>& splats);

class Guard {
 public:
  Guard(Device& device, OnNan on_nan);

  // Returns the buffer in which watched steps record values that are not finite. The view is empty if on_nan
  // is off.
  BufferView<std::uint32_t> sentinel() const { return sentinel_.view(); }
  // `report` is called with a message for every event after which training continues.
  void on_event(std::function<void(const std::string&)> report) { report_ = std::move(report); }

  // Must be called after every iteration. `left_out` is true if the iteration had no gradient, because all of
  // its views were skipped.
  void stepped(const TrainProgress& progress, bool left_out);
  // Returns whether look() must be called now. `before_others` is true if the state is about to be read or
  // changed by something other than the Adam step.
  bool due(int iteration, bool before_others) const;
  // Waits for the device and returns true if all values are finite. Otherwise it sets `progress` to the first
  // iteration with a value that is not finite. The steps after this iteration have not changed the state.
  bool look(TrainProgress& progress);

  // wants_state() returns whether a state for rollbacks is still needed. keep() sets the state to which a
  // rollback returns.
  bool wants_state() const { return on_nan_ == OnNan::rollback && !good_; }
  void keep(TrainState state);
  // Must be called after the training state was replaced.
  void restart(const TrainState& state);
  // Returns the state from which training continues. `state` is the state in which the event was found.
  // Throws Error(numerical) if training must stop. The text of the error or of the report contains the
  // iteration, the stage and, if they are known, the view and the first splat.
  TrainState answer(const NonFiniteEvent& event, TrainState state, TrainingViews& views);

 private:
  // Maximum number of iterations between two checks of the sentinel.
  static constexpr std::size_t kLookEvery = 16;

  OnNan on_nan_;
  Buffer<std::uint32_t> sentinel_;  // (1): iteration of the first value that is not finite; 0: none
  int looked_ = 0;                  // iteration of the last call of look()
  bool left_out_ = false;           // whether the last iteration had no gradient
  std::array<std::uint64_t, kLookEvery + 1> adam_steps_{};  // indexed by iteration modulo the size
  std::optional<TrainState> good_;                          // state to which a rollback returns
  std::function<void(const std::string&)> report_;
};

}  // namespace ubs
