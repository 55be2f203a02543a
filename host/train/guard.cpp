// SPDX-License-Identifier: Apache-2.0
#include "host/train/guard.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"

namespace ubs {
namespace {

// Raw values of a splat that is as good as absent: opacity 2e-9 (dead is below 5e-3), support radius 4.5e-5,
// query scales 1.
constexpr float kDeadOpacity = -20, kDeadScale = -10, kUnitScale = 0.541325f;

bool row_bad(const std::vector<float>& values, std::size_t row, std::size_t count, std::size_t i) {
  const std::size_t at = row * count + i;
  return at < values.size() && !std::isfinite(values[at]);
}

std::vector<float> column(const std::vector<float>& values, std::size_t count, std::size_t i) {
  std::vector<float> all;
  for (std::size_t at = i; at < values.size(); at += count) all.push_back(values[at]);
  return all;
}

float dead_value(const ParameterLayout& layout, int row, float present) {
  if (row < layout.rgb) return std::isfinite(present) ? present : 0.0f;
  if (row == layout.opacity) return kDeadOpacity;
  if (row >= layout.scale && row < layout.l_triangle) return row < layout.scale + 3 ? kDeadScale : kUnitScale;
  const bool quaternion = layout.variant.rot_mode == RotMode::quaternion;
  return quaternion && row == layout.l_triangle ? 1.0f : 0.0f;
}

}  // namespace

OnNan on_nan_from(const std::string& text) {
  if (text == "off") return OnNan::off;
  if (text == "rollback") return OnNan::rollback;
  if (text == "drop") return OnNan::drop;
  return OnNan::stop;
}

std::vector<std::uint32_t> splats_not_finite(const TrainState& state) {
  const std::size_t count = state.model.count;
  std::vector<bool> bad(count, false);
  for (const auto* values : {&state.model.values, &state.moment1, &state.moment2})
    for (std::size_t at = 0; at < values->size(); ++at)
      if (!std::isfinite((*values)[at])) bad[at % count] = true;
  std::vector<std::uint32_t> splats;
  for (std::size_t i = 0; i < count; ++i)
    if (bad[i]) splats.push_back(static_cast<std::uint32_t>(i));
  return splats;
}

void describe_splat(const TrainState& state, NonFiniteEvent& event) {
  if (event.splats.empty()) return;
  const std::size_t count = state.model.count, i = event.splats.front();
  event.splat = static_cast<std::int64_t>(i);
  event.raw = column(state.model.values, count, i);
  event.moment1 = column(state.moment1, count, i);
  event.moment2 = column(state.moment2, count, i);
  const bool all_rows = state.moment1.size() == state.model.values.size();  // no group is frozen
  const std::vector<std::string> names = state.model.layout().property_names();
  for (std::size_t r = 0; r < names.size() && event.parameter.empty(); ++r)
    if (row_bad(state.model.values, r, count, i) ||
        (all_rows && (row_bad(state.moment1, r, count, i) || row_bad(state.moment2, r, count, i))))
      event.parameter = names[r];
}

SplatModel undo_adam(const TrainState& state, const AdamUndo& step) {
  SplatModel model = state.model;
  if (state.moment1.size() != model.values.size()) return model;
  for (std::size_t at = 0; at < model.values.size(); ++at) {
    const double m1 = state.moment1[at], m2 = state.moment2[at];
    if (!std::isfinite(m1) || !std::isfinite(m2)) continue;
    const double size = std::sqrt(m2) * step.inverse_sqrt_bias2 + step.epsilon;
    const double rate = step.learning_rates[at / model.count];
    model.values[at] = static_cast<float>(model.values[at] + rate * step.inverse_bias1 * m1 / size);
  }
  return model;
}

void kill_splats(TrainState& state, const std::vector<std::uint32_t>& splats) {
  SplatModel& model = state.model;
  const ParameterLayout layout = model.layout();
  for (const std::uint32_t i : splats) {
    for (int r = 0; r < layout.count; ++r) model.row(r)[i] = dead_value(layout, r, model.row(r)[i]);
    for (auto* moments : {&state.moment1, &state.moment2})
      for (std::size_t at = i; at < moments->size(); at += model.count) (*moments)[at] = 0;
  }
  state.dropped += splats.size();
}

std::string summary(const NonFiniteEvent& event) {
  std::string text = fmt::format("not finite at iteration {}", event.iteration);
  if (event.view >= 0) text += fmt::format(", view '{}' (train {})", event.view_name, event.view);
  if (event.splat >= 0) {
    text += fmt::format(", splat {}", event.splat);
    if (!event.parameter.empty()) text += fmt::format(", parameter {}", event.parameter);
    if (event.splats.size() > 1) text += fmt::format(" (and {} splats more)", event.splats.size() - 1);
  }
  text += fmt::format(", stage {}", event.stage);
  if (!event.where.empty()) text += fmt::format(": {}", event.where);
  return text;
}

}  // namespace ubs
