// SPDX-License-Identifier: Apache-2.0
// What training does when a parameter, a gradient or the loss is not finite (docs/training.md). The watched
// Adam step (host/device/stages.hpp) notices; here the first bad splat is found in the state that it left,
// the step is undone, and where wanted splats are taken out.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

enum class OnNan { off, stop, rollback, drop };
OnNan on_nan_from(const std::string& text);  // of TrainSettings::on_nan

inline constexpr int kMostRollbacks = 3;           // of a run
inline constexpr double kMostDroppedShare = 0.01;  // of the splats, over a run; but always kFewDropped
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
  std::vector<float> raw, gradient, moment1, moment2;  // gradient: of `view` alone, when it was made again
  std::vector<std::uint32_t> splats;                   // all with such a value, ascending
  std::string action;                                  // what training did about it
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

}  // namespace ubs
