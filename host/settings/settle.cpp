// SPDX-License-Identifier: Apache-2.0
#include "host/settings/settle.hpp"

#include <algorithm>
#include <utility>

#include "host/base/error.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/settings/fields.hpp"

namespace ubs {
namespace {

// Throws an error if the images may be transparent, and the settings require opaque images. Sets the colour
// that the training of a background starts with.
void settle_learnt_background(TrainSettings& s, const Facts& facts) {
  const bool learnt = s.background.learnt != Background::Learnt::no;
  const bool colour = !learnt && s.background.harmonics.empty();
  if (!facts.opaque() && facts.views > 0 && (!colour || s.random_background == RandomBackground::on))
    fail(
        ErrorKind::data,
        "{}: the image may be transparent, but a background that is learnt or random requires opaque images: "
        "choose --background R,G,B and --random-background off",
        facts.transparent);
  s.background.automatic = false;
  if (learnt) s.background.colour = facts.mean_colour;
}

void check_unit(const TrainSettings& s) {
  if (s.unit != 1 && !has_free_unit(s.variant))
    fail(ErrorKind::usage,
         "cov_param = skew_nd can only be trained in the unit of the data: choose unit = 1");
}

std::vector<std::string> notes_about(const TrainSettings& asked, const TrainSettings& s, const Facts& facts) {
  std::vector<std::string> notes;
  if (asked.background.automatic && facts.opaque())
    notes.push_back(fmt::format("background {}: the mean colour of the images (--background){}",
                                fmt::join(s.background.colour, ","),
                                s.random_background == RandomBackground::on
                                    ? ", and random colours during training (--random-background)"
                                    : ""));
  if (asked.dim == kAutoInt)
    notes.push_back(
        fmt::format("dim auto: N = {}, {}{}", s.dim, facts.dim.reason,
                    s.variant.direct() && asked.conditioning_auto
                        ? "; direct conditioning (for the published variant: --conditioning covariance)"
                        : ""));
  if (facts.wide_images && asked.opacity_reg == kAuto)
    notes.emplace_back(
        "training without opacity penalty, because wide images were split into several views (to use a "
        "penalty: --set opacity_reg=NUMBER)");
  if (asked.unit == kAuto && has_free_unit(s.variant) && facts.depth > 0)
    notes.push_back(fmt::format("training divides all lengths of the data by {:.4g} (--unit)", s.unit));
  const auto cap = static_cast<std::size_t>(s.cap_max);
  if (facts.points > cap)
    notes.push_back(
        fmt::format("using {} of {} points, evenly spaced, because cap_max is {}", cap, facts.points, cap));
  else if (facts.points == 0 && s.init_points > s.cap_max)
    notes.push_back(
        fmt::format("using {} initial splats instead of {}, because cap_max is {}", cap, s.init_points, cap));
  return notes;
}

std::vector<std::string> warnings_about(const TrainSettings& s, const Facts& facts) {
  std::vector<std::string> warnings;
  if (facts.views == 0) return warnings;
  if (has_time(s.dim) && !facts.moves)
    warnings.push_back(fmt::format(
        "all training views have the same time, so N = {} cannot learn motion: use --dim {} for a "
        "static scene",
        s.dim, s.dim >= 6 ? 6 : 3));
  if (facts.one_place)
    warnings.emplace_back(
        "all training cameras have the same position, so the depth of what they see cannot be learnt: check "
        "the camera poses");
  if (!has_time(s.dim) && facts.moves)
    warnings.push_back(
        fmt::format("the training views have different times, but N = {} has no time dimension, so moving "
                    "objects will be blurred: use --dim {}",
                    s.dim, s.dim == 3 ? 4 : 7));
  return warnings;
}

}  // namespace

Plan::Plan(TrainSettings complete) : recorded_(std::move(complete)) {
  const std::vector<FieldValue> fields = bind_fields(recorded_, train_fields());
  for (std::size_t i = 0; i < fields.size(); ++i)
    if (train_fields()[i].decide && is_automatic(fields[i]))
      fail(ErrorKind::internal, "the setting {} of a plan is automatic", fields[i].key);
  trained_ = recorded_;
  trained_.unit = 1;
  for (double* length : {&trained_.near_plane, &trained_.far_plane, &trained_.init_extent})
    if (*length != kAuto) *length /= recorded_.unit;
}

void Plan::set_length(const TrainSettings& from) {
  for (TrainSettings* s : {&recorded_, &trained_}) {
    s->iterations = from.iterations;
    s->work_shares = from.work_shares;
    s->growth_end = from.growth_end;
  }
}

Settled settle(const TrainSettings& asked, const Facts& facts) {
  TrainSettings s = asked;
  const std::vector<FieldValue> fields = bind_fields(s, train_fields());
  for (std::size_t i = 0; i < fields.size(); ++i)
    if (const auto& field = train_fields()[i]; field.decide && is_automatic(fields[i]))
      field.decide(s, asked, facts);
  s.budget = "none";
  settle_learnt_background(s, facts);
  check_unit(s);
  validate(s);
  return {Plan(s), notes_about(asked, s, facts), warnings_about(s, facts)};
}

Plan settle(const TrainSettings& asked) {
  static const Facts nothing;  // GCC 12 warns about uninitialised members if this is a temporary object
  return settle(asked, nothing).plan;
}

int points_to_find(const TrainSettings& asked, bool moves) {
  // Number of points that are searched for per second of a budget
  // (docs/results/2026-11-29-time-before-training.md).
  constexpr double kFoundPerSecond = 1000, kMostFound = 75'000;
  if (asked.find_points != kAutoInt) return moves ? 0 : asked.find_points;
  if (moves || asked.init_points != kAutoInt || asked.init_extent != kAuto) return 0;
  const double seconds = budget_seconds(asked);
  return static_cast<int>(seconds > 0 ? std::min(kFoundPerSecond * seconds, kMostFound) : kMostFound);
}

std::size_t first_splats(const TrainSettings& s, const Facts& facts) {
  return std::min(facts.points > 0 ? facts.points : static_cast<std::size_t>(s.init_points),
                  static_cast<std::size_t>(s.cap_max));
}

std::vector<std::string> changed_keys(TrainSettings asked, TrainSettings settled) {
  const std::vector<FieldValue> before = bind_fields(asked, train_fields()),
                                after = bind_fields(settled, train_fields());
  std::vector<std::string> keys;
  for (std::size_t i = 0; i < before.size(); ++i)
    if (field_text(before[i]) != field_text(after[i])) keys.emplace_back(before[i].key);
  return keys;
}

}  // namespace ubs
