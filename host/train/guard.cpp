// SPDX-License-Identifier: Apache-2.0
#include "host/train/guard.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/train/training_views.hpp"

namespace ubs {
namespace {

// Raw values of a splat that has practically no effect. Its opacity is 2e-9, which is far below 5e-3, the
// limit below which a splat counts as dead. Its support radius is 4.5e-5, and its scales in the query
// dimensions are 1.
constexpr float kDeadOpacity = -20, kDeadScale = -10, kUnitScale = 0.541325f;

float dead_value(const ParameterLayout& layout, int row, float present) {
  if (row < layout.rgb) return std::isfinite(present) ? present : 0.0f;
  if (row == layout.opacity) return kDeadOpacity;
  if (row >= layout.scale && row < layout.l_triangle) return row < layout.scale + 3 ? kDeadScale : kUnitScale;
  const bool quaternion = layout.variant.rot_mode == RotMode::quaternion;
  return quaternion && row == layout.l_triangle ? 1.0f : 0.0f;
}

std::string summary(const NonFiniteEvent& event, const TrainingViews& views) {
  std::string text = fmt::format("values that are not finite at iteration {}, stage {}", event.iteration,
                                 event.source.stage);
  if (const std::int64_t view = event.source.view; view >= 0)
    text += fmt::format(", view '{}'", views.train().views[static_cast<std::size_t>(view)].name);
  if (!event.splats.empty()) text += fmt::format(", splat {}", event.splats.front());
  if (event.splats.size() > 1) text += fmt::format(" (and {} more splats)", event.splats.size() - 1);
  return text;
}

}  // namespace

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

Guard::Guard(Device& device, OnNan on_nan) : on_nan_(on_nan) {
  if (on_nan == OnNan::off) return;
  sentinel_ = Buffer<std::uint32_t>(device, "sentinel", 1);
  sentinel_.zero();
}

void Guard::stepped(const TrainProgress& progress, bool left_out) {
  adam_steps_[static_cast<std::size_t>(progress.iteration) % adam_steps_.size()] = progress.adam_steps;
  left_out_ = left_out;
}

bool Guard::due(int iteration, bool before_others) const {
  return on_nan_ != OnNan::off &&
         (before_others || left_out_ || static_cast<std::size_t>(iteration - looked_) >= kLookEvery);
}

bool Guard::look(TrainProgress& progress) {
  if (on_nan_ == OnNan::off) return true;
  std::uint32_t stamp = 0;
  sentinel_.download(std::span(&stamp, 1));
  looked_ = progress.iteration;
  if (stamp == 0) return true;
  sentinel_.zero();
  progress.iteration = looked_ = static_cast<int>(stamp);
  progress.adam_steps = adam_steps_[stamp % adam_steps_.size()];
  return false;
}

void Guard::keep(TrainState state) {
  if (on_nan_ == OnNan::rollback) good_ = std::move(state);
}

void Guard::restart(const TrainState& state) {
  looked_ = state.iteration;
  adam_steps_.fill(state.adam_steps);
  if (sentinel_) sentinel_.zero();
  keep(state);
}

TrainState Guard::answer(const NonFiniteEvent& event, TrainState s, TrainingViews& views) {
  const auto stop = [&](const std::string& why) {
    fail(ErrorKind::numerical, "{}; {}", summary(event, views), why);
  };
  const auto go_on = [&](const std::string& how) {
    if (report_) report_(fmt::format("{}; {}", summary(event, views), how));
  };
  const std::uint64_t first = views.first_draw(event.iteration), end = first + views.batch();
  if (on_nan_ == OnNan::rollback) {
    if (s.rollbacks >= kMaxRollbacks) stop(fmt::format("stopped after {} rollbacks", s.rollbacks));
    go_on(fmt::format("going back to iteration {}; {} of iteration {} will be skipped", good_->iteration,
                      event.source.view < 0 ? "all views" : "this view", event.iteration));
    TrainState next = *good_;
    next.seconds = s.seconds;  // the time since that state counts as training time
    next.rollbacks = s.rollbacks + 1;
    next.skipped_draws = std::move(s.skipped_draws);
    for (std::uint64_t draw = first; draw < end; ++draw)
      if (event.source.view < 0 || views.view_of(draw) == static_cast<std::uint32_t>(event.source.view))
        next.skipped_draws.insert(draw);
    return next;
  }
  if (on_nan_ != OnNan::drop || event.splats.empty()) stop("stopped");
  const auto most = std::max<std::uint64_t>(
      kFewDropped, static_cast<std::uint64_t>(kMaxDroppedShare * static_cast<double>(s.model.count)));
  if (const std::uint64_t all = s.dropped + event.splats.size(); all > most)
    stop(fmt::format("stopped: {} splats would have been dropped in this run, but at most {} are allowed",
                     all, most));
  go_on(fmt::format("dropped {} splats", event.splats.size()));
  kill_splats(s, event.splats);
  for (std::uint64_t draw = first; draw < end; ++draw)  // the losses of these draws may not be finite either
    s.skipped_draws.insert(draw);
  return s;
}

}  // namespace ubs
