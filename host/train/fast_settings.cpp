// SPDX-License-Identifier: Apache-2.0
#include "host/train/fast_settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "host/train/schedule.hpp"

namespace ubs {
namespace {

// A refinement takes as long as an Adam step and resets the moments of the splats that it moves. Therefore
// fast runs refine every 100 iterations, as published, and do not scale this interval with the length of the
// run (docs/results/2026-11-21-quality-per-second.md). In runs of fewer than 1000 iterations, the interval is
// the number of iterations divided by kMinRefinements.
constexpr int kRefineEvery = 100, kMinRefinements = 10;
constexpr double kGrownAt = 0.5;  // share of the run by which growth reaches the maximum number of splats
// Randomly placed splats have to move to the surfaces of the scene, over a distance that does not depend on
// the length of the run. Therefore the learning rate of positions is kFarTravel divided by the number of
// iterations. kFarTravel is about the published rate times 30 000 iterations. The rate is at most kFastest,
// because higher rates destroy structure that the model already has.
constexpr double kFarTravel = 5, kFastest = 3e-3;
// The maximum number of splats is kSplatsAnIteration times the number of iterations of the run, but at least
// kMinSplats. Splats from initial points are better than splats that growth adds, so the maximum is increased
// to the number of initial points, up to kPointsAnIteration times the number of iterations.
constexpr int kSplatsAnIteration = 12, kPointsAnIteration = 40, kMinSplats = 10000;

// fast_settings() has the values for runs of at most kShortRun iterations. In longer runs, learning rates and
// the share of the work that uses reduced images decrease as powers of the number of iterations
// (docs/results/2026-11-22-long-schedules.md).
constexpr int kShortRun = 2000;
constexpr double kPyramidPower = 0.5;
// Image pyramids for images of more than kLargePixels pixels, and for runs that use each image fewer than
// kFewUses times on average. In runs of at most kShortRun iterations, both use images of full size only in
// the last 5 % of the work (docs/results/2026-11-29-image-size.md).
constexpr double kLargePixels = 1e6;
constexpr int kFewUses = 4;
constexpr const char *kPyramidOfLarge = "4:0.5,2:0.95", *kPyramidOfFewUses = "4:0.7,2:0.95";
// lr_cooldown of models with direct conditioning and time (docs/results/2026-11-24-budgets.md).
constexpr double kMovingCooldown = 0.6;
// opacity_reg of runs with few images (docs/results/2026-11-25-few-photographs.md), and of runs with random
// background colours (docs/results/2026-11-28-opaque.md).
constexpr double kFewOpacityReg = 0.02, kOpaqueOpacityReg = 0;
// Exponent of the decrease of beta_dir_init. It is only used for static scenes that have initial points and
// no plain background.
constexpr double kDirectionPower = 1.2;
// A learning rate that is multiplied by (iterations / kShortRun)^-power in runs longer than kShortRun.
struct FallingRate {
  const char* key;
  double TrainSettings::*rate;
  double power;
};
constexpr FallingRate kFallingRates[] = {
    {"lr_rgb", &TrainSettings::lr_rgb, 0.35},   {"lr_l_triangle", &TrainSettings::lr_l_triangle, 0.35},
    {"lr_mean", &TrainSettings::lr_mean, 0.35}, {"lr_scale", &TrainSettings::lr_scale, 0.35},
    {"lr_beta", &TrainSettings::lr_beta, 0.6},  {"lr_xyz_final", &TrainSettings::lr_xyz_final, 1.6}};

double fallen(double value, double power, int iterations) {
  return value * std::pow(std::max(1.0, double{1} * iterations / kShortRun), -power);
}

// Returns whether the setting `key` may be adapted: the user has not chosen it, and it still has the value
// `usual`.
template <typename Value>
bool is_free(const TrainSettings& s, const char* key, const Value& value, const Value& usual) {
  return value == usual && !s.chosen.contains(key);
}

std::string usual_pyramid(int iterations, const PictureFacts& pictures) {
  if (static_cast<double>(iterations) < kFewUses * static_cast<double>(pictures.views))
    return kPyramidOfFewUses;
  return pictures.pixels > kLargePixels ? kPyramidOfLarge : fast_settings().pyramid;
}

// Adapts the settings that decrease with the length of the run to the number of iterations. Values are
// rounded to a few digits to keep config.yaml readable.
void lengthen(TrainSettings& s, int iterations, bool direction_falls, const PictureFacts& pictures) {
  TrainSettings base = fast_settings();
  const auto fall = [&](const char* key, double TrainSettings::*value, double power) {
    if (is_free(s, key, s.*value, base.*value))
      s.*value = std::stod(fmt::format("{:.3g}", fallen(base.*value, power, iterations)));
  };
  for (const auto& [key, rate, power] : kFallingRates) fall(key, rate, power);
  if (direction_falls && !has_time(s.dim))
    fall("beta_dir_init", &TrainSettings::beta_dir_init, kDirectionPower);
  if (!is_free(s, "pyramid", s.pyramid, base.pyramid)) return;
  base.pyramid = usual_pyramid(iterations, pictures);
  s.pyramid.clear();
  for (const PyramidStep& step : pyramid_steps(base))
    s.pyramid += fmt::format("{}{}:{:.2g}", s.pyramid.empty() ? "" : ",", step.factor,
                             fallen(step.share, kPyramidPower, iterations));
}

// Returns whether the model has a time dimension and direct conditioning. This is the default for dynamic
// scenes.
bool moves(const TrainSettings& s) { return s.dim != kAutoInt && has_time(s.dim) && s.variant.direct(); }

int refine_interval(int iterations) { return std::clamp(iterations / kMinRefinements, 1, kRefineEvery); }

}  // namespace

std::size_t first_splats(const TrainSettings& s, std::size_t points) {
  return std::min(points > 0 ? points : static_cast<std::size_t>(s.init_points),
                  static_cast<std::size_t>(s.cap_max));
}

TrainSettings fast_settings() {
  TrainSettings s;
  s.lr_cooldown = 0.15;
  s.lr_xyz_final = 4e-5;
  s.lr_scale = 0.02;
  s.lr_rgb = 0.005;
  s.lr_l_triangle = 0.005;
  s.lr_beta = 0.01;
  s.lr_mean = 0.005;
  s.beta_dir_init = -3;
  s.pyramid = "4:0.5,2:0.8";
  return s;
}

int fast_run_splats(int iterations, std::size_t points) {
  const auto kept = std::min(points, static_cast<std::size_t>(kPointsAnIteration) * iterations);
  return std::max({kMinSplats, kSplatsAnIteration * iterations, static_cast<int>(kept)});
}

TrainSettings fast_settings_for(const TrainSettings& settings, int iterations, std::size_t points,
                                const PictureFacts& pictures) {
  const TrainSettings standard;
  TrainSettings s = settings;
  s.iterations = iterations;
  if (is_free(s, "cap_max", s.cap_max, standard.cap_max))
    s.cap_max = std::min(s.cap_max, fast_run_splats(iterations, points));
  // If points are triangulated from the images (points > 0), init_points stays at auto, so that a run with
  // the same settings triangulates them again.
  if (points == 0 && s.init_points == standard.init_points)
    s.init_points =
        static_cast<int>(std::min(static_cast<std::size_t>(s.cap_max / 2), pictures.random_points));
  lengthen(s, iterations, points > 0 && !pictures.lone_object, pictures);
  if (moves(s) && is_free(s, "lr_cooldown", s.lr_cooldown, fast_settings().lr_cooldown))
    s.lr_cooldown = kMovingCooldown;
  if (is_free(s, "opacity_reg", s.opacity_reg, standard.opacity_reg))
    s.opacity_reg = pictures.wide_images                          ? kWideOpacityReg
                    : pictures.few_photographs                    ? kFewOpacityReg
                    : s.random_background == RandomBackground::on ? kOpaqueOpacityReg
                                                                  : s.opacity_reg;
  if (points == 0 && is_free(s, "lr_xyz", s.lr_xyz, standard.lr_xyz))
    s.lr_xyz = std::clamp(kFarTravel / iterations, standard.lr_xyz, kFastest);
  const int interval = refine_interval(iterations);
  if (is_free(s, "refine", s.refine.step, standard.refine.step))
    s.refine.step = std::min(
        kScheduleLength, static_cast<int>(std::llround(double{1} * interval * kScheduleLength / iterations)));
  const double first = static_cast<double>(s.refine.first) / kScheduleLength;
  if (first < kGrownAt && !s.refine.empty() && is_free(s, "growth", s.growth, standard.growth)) {
    const double start = static_cast<double>(first_splats(s, points));
    const double events = std::max(1.0, std::floor((kGrownAt - first) * iterations / interval));
    // Round the growth factor up to four decimals, to keep config.yaml readable. Each refinement rounds the
    // number of splats down, so increase the factor until the schedule reaches cap_max.
    const double ratio = std::max(1.0, s.cap_max / start);
    double steps = std::ceil(std::pow(ratio, 1 / events) * 1e4);
    const auto grown = [&] {
      s.growth = std::min(steps / 1e4, 10.0);
      return s.growth == 10 || Schedule(s, first_splats(s, points)).splats_at(kGrownAt) >=
                                   static_cast<std::uint32_t>(s.cap_max);
    };
    while (!grown()) ++steps;
  }
  return s;
}

}  // namespace ubs
