// SPDX-License-Identifier: Apache-2.0
// This file parses the settings that are texts, and checks combinations of settings.
#include "host/settings/train_settings.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/text.hpp"
#include "host/scene/frozen_groups.hpp"

namespace ubs {
namespace {

constexpr int kMaxPyramidFactor = 64;
constexpr double kMinAlphaMin = 1e-6;  // kernels/math/reach.h does not support smaller values
constexpr double kLeastBudget = 0.5;   // [s]; measuring steps and kMinIterations take longer on every device

}  // namespace

bool freezes_shape(const TrainSettings& s) {
  const std::uint32_t frozen = frozen_groups(ParameterLayout(s.dim, s.variant), s.freeze);
  return is_frozen(frozen, "scale") || is_frozen(frozen, "l_triangle");
}

// Throws Error(usage) if refinements would change a frozen group: relocation moves splats and reduces the
// opacity of the splats that it copies. The other groups are copied without changes.
void check_freeze(const TrainSettings& s) {
  const std::uint32_t frozen = frozen_groups(ParameterLayout(s.dim, s.variant), s.freeze);
  for (const char* group : {"xyz", "opacity"})
    if (is_frozen(frozen, group) && (s.refine == kAutoRange || !s.refine.empty()))
      fail(ErrorKind::usage,
           "freeze = '{}': relocation and growth would change {}: disable them with refine = 0:0:1", s.freeze,
           group);
  if (s.copy_spread > 0 && freezes_shape(s) && (s.refine == kAutoRange || !s.refine.empty()))
    fail(ErrorKind::usage,
         "freeze = '{}': relocation and growth would change the shape of splats: set copy_spread = 0",
         s.freeze);
}

Planes planes_of(const TrainSettings& s) {
  const double unit = s.unit == kAuto ? 1 : s.unit;
  return {s.near_plane == kAuto ? 0.01 * unit : s.near_plane,
          s.far_plane == kAuto ? 1e10 * unit : s.far_plane};
}

double budget_seconds(const TrainSettings& s) {
  if (s.budget == "auto")
    return s.iterations == kAutoInt && s.schedule == ScheduleKind::fast ? kDefaultSeconds : 0;
  if (s.budget == "none") return 0;
  const double seconds = parse_duration(s.budget, "budget");
  if (seconds < kLeastBudget)
    fail(ErrorKind::usage, "budget {}: training takes at least {:g} s: increase the budget", s.budget,
         kLeastBudget);
  return seconds;
}

void validate(const TrainSettings& s) {
  if (s.budget.starts_with('+'))
    fail(ErrorKind::usage, "budget {}: only a run that is resumed can get additional time", s.budget);
  if (s.budget != "auto" && budget_seconds(s) > 0 && s.iterations != kAutoInt)
    fail(ErrorKind::usage,
         "--budget chooses the number of iterations: remove --budget or --iterations (in a file of settings, "
         "the line 'iterations')");
  if (s.alpha_min > 0 && s.alpha_min < kMinAlphaMin)
    fail(ErrorKind::usage, "alpha_min = {} must be 0 or at least {}", s.alpha_min, kMinAlphaMin);
  if (s.dim != kAutoInt) {
    check_variant(s.dim, s.variant);
    check_freeze(s);
  }
  if (const auto [near, far] = planes_of(s); far <= near)
    fail(ErrorKind::usage, "far_plane = {} must be larger than near_plane = {}", far, near);
  const bool sky = s.background.learnt == Background::Learnt::sky || !s.background.harmonics.empty();
  if (sky && s.refine_cameras != RefineCameras::none)
    fail(ErrorKind::usage, "refine_cameras does not support background = sky: choose background = learn");
  if (s.random_background == RandomBackground::on && (sky || s.background.learnt != Background::Learnt::no))
    fail(ErrorKind::usage,
         "random_background = on does not support a learnt background or a sky: choose a background colour");
  evaluation_interval(s);
  checkpoint_interval(s);
  pyramid_steps(s);
  share_points(s);
  if (s.refine != kAutoRange && (s.refine.first > s.refine.end || s.refine.step < 1))
    fail(ErrorKind::usage, "refine = {} must be FIRST:END:STEP, and END must not be smaller than FIRST",
         to_string(s.refine));
  if (s.frames.empty())
    fail(ErrorKind::usage, "frames = {} selects no frame: END must be larger than FIRST",
         to_string(s.frames));
}

static RunInterval run_interval(const char* key, const std::string& text) {
  const bool by_time = text.ends_with('s');
  double value = -1;
  const char* const end = text.data() + text.size() - (by_time ? 1 : 0);
  const auto result = std::from_chars(text.data(), end, value);
  if (result.ec != std::errc() || result.ptr != end || !(value >= 0) || value > 1e9 ||
      (!by_time && value != std::floor(value)))
    fail(ErrorKind::usage, "{} = '{}' must be iterations such as 500, or seconds such as 300s", key, text);
  return by_time ? RunInterval{0, value} : RunInterval{static_cast<int>(value), 0};
}

RunInterval evaluation_interval(const TrainSettings& s) { return run_interval("eval_every", s.eval_every); }
RunInterval checkpoint_interval(const TrainSettings& s) {
  return run_interval("checkpoint_every", s.checkpoint_every);
}

// Reads a number from the front of the text, and the character `closing` that must follow it. If `closing` is
// a comma, the text may also end after the number, but not after the comma.
template <typename T>
static bool take_number(const char*& at, const char* end, char closing, T& value) {
  const auto result = std::from_chars(at, end, value);
  if (result.ec != std::errc()) return false;
  at = result.ptr;
  if (at == end) return closing == ',';  // no comma follows the last entry
  return *at++ == closing && (closing != ',' || at != end);
}

SharePoint reached(const SharePoint& from, const SharePoint& to) {
  if (to.left_at == 0) return to;
  return {to.left_at, from.share + (to.share - from.share) * (to.left_at - from.iteration) /
                                       (to.iteration - from.iteration)};
}

std::vector<SharePoint> share_points(const TrainSettings& s) {
  std::vector<SharePoint> points;
  const char* at = s.work_shares.data();
  const char* const end = at + s.work_shares.size();
  SharePoint last;
  while (at != end) {
    SharePoint point;
    const char* const entry_end = std::find(at, end, ',');
    const bool left = std::find(at, entry_end, '@') != entry_end;
    const bool read = take_number(at, end, ':', point.iteration) &&
                      take_number(at, end, left ? '@' : ',', point.share) &&
                      (!left || take_number(at, end, ',', point.left_at));
    const bool goes_on = last.share == 1 && point.share < 1;  // a finished run was continued
    if (!read || point.iteration <= last.iteration || !(point.share > last.share || goes_on) ||
        !(point.share <= 1) ||
        (left && (point.left_at <= last.iteration || point.left_at >= point.iteration)))
      fail(ErrorKind::usage,
           "work_shares must be empty or a list of ITERATION:SHARE in which both increase, such as "
           "90:0.05,200:0.1, but the entry after '{}:{}' is invalid",
           last.iteration, last.share);
    points.push_back(point);
    last = reached(last, point);
  }
  if (points.empty() || s.iterations == kAutoInt) return points;
  if (last.iteration > s.iterations || (last.share == 1) != (last.iteration == s.iterations))
    fail(ErrorKind::usage,
         "work_shares ends with a share of {} after iteration {}, which does not match iterations = {}: use "
         "work_shares and iterations of the same run, or do not set work_shares",
         last.share, last.iteration, s.iterations);
  return points;
}

std::string to_string(const std::vector<SharePoint>& points) {
  std::string text;
  for (const SharePoint& point : points) {
    text += fmt::format("{}{}:{}", text.empty() ? "" : ",", point.iteration, point.share);
    if (point.left_at > 0) text += fmt::format("@{}", point.left_at);
  }
  return text;
}

std::vector<PyramidStep> pyramid_steps(const TrainSettings& s) {
  std::vector<PyramidStep> steps;
  if (s.pyramid == "auto") return steps;
  const char* at = s.pyramid.data();
  const char* const end = at + s.pyramid.size();
  while (at != end) {
    PyramidStep step;
    const PyramidStep before = steps.empty() ? PyramidStep{kMaxPyramidFactor + 1, 0} : steps.back();
    if (!take_number(at, end, ':', step.factor) || !take_number(at, end, ',', step.share) ||
        step.factor < 2 || step.factor >= before.factor || !(step.share > before.share) || !(step.share < 1))
      fail(ErrorKind::usage,
           "pyramid = '{}' must be empty or a list of FACTOR:SHARE, such as 4:0.2,2:0.5: factors must be "
           "from {} to 2 and decrease, and shares must be below 1 and increase",
           s.pyramid, kMaxPyramidFactor);
    steps.push_back(step);
  }
  return steps;
}

}  // namespace ubs
