// SPDX-License-Identifier: Apache-2.0
// What training does when a parameter, a gradient or the loss is not finite (docs/training.md). The watched
// Adam step (host/device/stages.hpp) notices and does nothing from there on; Guard looks, and answers with
// the state that training goes on from. Around it: the first bad splat in a state, a step undone, splats
// taken out.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/device/device.hpp"
#include "host/scene/splat_model.hpp"
#include "host/spec/train_settings.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

inline constexpr int kMaxRollbacks = 3;           // of a run
inline constexpr double kMaxDroppedShare = 0.01;  // of the splats, over a run; but always kFewDropped
inline constexpr std::uint64_t kFewDropped = 10;

struct NonFiniteEvent {
  int iteration = 0;
  std::string stage;       // whose output was the first that is not finite
  std::string where;       // in that output
  std::int64_t view = -1;  // training view whose pass it was; -1: none, or not found
  std::string view_name;
  // The first splat with a value that is not finite, all of its rows, and which parameter it was; -1: none.
  std::int64_t splat = -1;
  std::string parameter;
  // gradient: of `view` alone, or where that was not found of the last view, when it was made again
  std::vector<float> raw, gradient, moment1, moment2;
  std::vector<std::uint32_t> splats;  // all with such a value, ascending
  std::string action;                 // what training did about it
  SplatModel model;  // before the iteration, to a unit in the last place; values not finite replaced by 0
  std::size_t replaced = 0;  // number of these
};

// Learning rates (by parameter row) and bias corrections of the Adam step that is to be undone.
struct AdamUndo {
  std::vector<float> learning_rates;
  double inverse_bias1 = 1, inverse_sqrt_bias2 = 1, epsilon = 1e-15;
};

// Splats with a parameter or moment that is not finite, ascending.
std::vector<std::uint32_t> splats_not_finite(const TrainState& state);
// Fills splat, parameter, raw and moments of the first of `splats`.
void describe_splat(const TrainState& state, NonFiniteEvent& event);

// Parameters before the step that made the moments what they are. A parameter with a moment that is not
// finite was not moved by the watched step. Rounding: the step is taken back in double, so that the result is
// within one unit in the last place of the parameter or of the step.
SplatModel undo_adam(const TrainState& state, const AdamUndo& step);

// Makes the splats dead, that is: finite, nearly transparent and small, where they were when that is known.
// Moments become zero. Relocation finds them and puts them where splats are wanted.
void kill_splats(TrainState& state, const std::vector<std::uint32_t>& splats);

// One line for people: iteration, view, splat, parameter with its values, stage, action.
std::string summary(const NonFiniteEvent& event);

class TrainingViews;

class Guard {
 public:
  Guard(Device& device, OnNan on_nan);

  // For the steps that are watched; an empty view where none is.
  BufferView<std::uint32_t> sentinel() const { return sentinel_.view(); }
  void on_event(std::function<void(const NonFiniteEvent&)> report) { report_ = std::move(report); }

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
  // stops. Reports the event.
  TrainState answer(NonFiniteEvent event, TrainState state, TrainingViews& views);

 private:
  static constexpr std::size_t kLookEvery = 16;  // iterations between looks at the sentinel, at most

  [[noreturn]] void stop(NonFiniteEvent& event, const std::string& why);
  void tell(NonFiniteEvent& event, std::string action);

  OnNan on_nan_;
  Buffer<std::uint32_t> sentinel_;  // (1): iteration of the first value that is not finite; 0: none
  int looked_ = 0;                  // iteration of the last look
  bool left_out_ = false;           // the last iteration
  std::array<std::uint64_t, kLookEvery + 1> adam_steps_{};  // by iteration modulo its size
  std::optional<TrainState> good_;
  std::function<void(const NonFiniteEvent&)> report_;
};

}  // namespace ubs
