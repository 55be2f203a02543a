// SPDX-License-Identifier: Apache-2.0
// This file contains the table of the settings of a training, except for those of read_settings.hpp. A row
// has the key, the help text and the range of a setting, and the rule for its automatic value. A rule may use
// the settings in the rows before it. --help and config.yaml list the settings in the order of the rows.
#include <algorithm>
#include <cmath>
#include <iterator>

#include "host/base/error.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/scene/spatial_kernel.hpp"
#include "host/settings/facts.hpp"
#include "host/settings/schedule.hpp"
#include "host/settings/settle.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {
namespace {

using S = TrainSettings;

constexpr int kMaxSplats = 100'000'000;     // far more than useful models have; catches typing errors
constexpr double kMinDecayingRate = 1e-30;  // the decay cannot reach 0; a rate this small has no effect
constexpr int kMaxIterations = 10'000'000;  // also catches typing errors
constexpr double kMinLength = 1e-20, kMaxLength = 1e30;  // both are in the range of single precision

template <auto Switch>
ChoiceRef form(S& settings) {
  return choice<ModelVariant, Switch>(settings.variant);
}

// Returns a reference to the setting `conditioning`, whose words are `auto`, followed by the kinds of
// conditioning.
ChoiceRef conditioning(S& settings) {
  return {&settings,
          [](const void* at) {
            const S& s = *static_cast<const S*>(at);
            return s.conditioning_auto ? 0 : 1 + static_cast<int>(s.variant.conditioning);
          },
          [](void* at, int number) {
            S& s = *static_cast<S*>(at);
            s.conditioning_auto = number == 0;
            s.variant.conditioning = static_cast<Conditioning>(std::max(number - 1, 0));
          }};
}

constexpr auto used = &with_uses<S>;

Field<S> decided(unsigned uses, Field<S> field, Field<S>::Rule rule) {
  field.uses = uses;
  field.automatic = true;
  field.decide = rule;
  return field;
}

// ---- Rules ----

// Published values (method.md 1.3, 4.2 to 4.4).
constexpr int kPublishedSplats = 300'000;
constexpr double kGrowth = 1.02, kRateOfPositions = 1.6e-4, kNoise = 1e6, kOpacityReg = 0.01;
// The noise of static scenes if the unit is the depth of the scene. Relative to the size of the scene, the
// noise of the positions grows with the square of the unit. The published value 1e6 was chosen for scenes
// whose depth is about 4 units, so it corresponds to 4^2 * 1e6 if the unit is the depth. The schedule fast
// uses 1e6, which gave 0.2 dB more on lego_200 (two seeds).
constexpr double kNoiseOfDepth = 1.6e7;
// With 0.35 and 0.5, four moving scenes had about the same mean PSNR, and with 0.25 and 0.7 less
// (docs/results/2026-12-01-copies.md).
constexpr double kCopySpread = 0.35;

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

// In fast runs of more than kShortRun iterations, learning rates and the share of the work that uses reduced
// images decrease as powers of the number of iterations (docs/results/2026-11-22-long-schedules.md).
constexpr int kShortRun = 2000;
constexpr double kPyramidPower = 0.5;
// Image pyramids for images of more than kLargePixels pixels, and for runs that use each image fewer than
// kFewUses times on average. In runs of at most kShortRun iterations, both use images of full size only in
// the last 5 % of the work (docs/results/2026-11-29-image-size.md).
constexpr double kLargePixels = 1e6;
constexpr int kFewUses = 4;
constexpr const char *kPyramid = "4:0.5,2:0.8", *kPyramidOfLarge = "4:0.5,2:0.95",
                     *kPyramidOfFewUses = "4:0.7,2:0.95";
// lr_cooldown, also of models with direct conditioning and time (docs/results/2026-11-24-budgets.md).
constexpr double kCooldown = 0.15, kMovingCooldown = 0.6;
// opacity_reg of runs with few images (docs/results/2026-11-25-few-photographs.md), and of runs with random
// background colours (docs/results/2026-11-28-opaque.md).
constexpr double kFewOpacityReg = 0.02, kOpaqueOpacityReg = 0;
// opacity_reg if the views are parts of wide images. Each iteration trains one view, but the penalty acts on
// all splats. If the views look in all directions, most splats get no gradient in an iteration, and the
// penalty would make them fade.
constexpr double kWideOpacityReg = 0;
// beta_dir_init makes splats visible from a wider range of directions at first. It decreases with this
// exponent.
constexpr double kFastBetaDir = -3, kDirectionPower = 1.2;

bool fast(const S& s) { return s.schedule == ScheduleKind::fast; }

int fail_without_data() { fail(ErrorKind::usage, "dim = auto requires data: pass a number from 3 to 11"); }

double fallen(double value, double power, int iterations) {
  return value * std::pow(std::max(1.0, double{1} * iterations / kShortRun), -power);
}

// Returns a value that decreases with the length of the run, rounded to a few digits to keep config.yaml
// readable.
double falling(const S& s, double value, double power) {
  return std::stod(fmt::format("{:.3g}", fallen(value, power, s.iterations)));
}

int splats_for(int iterations, std::size_t points) {
  const auto kept = std::min(points, static_cast<std::size_t>(kPointsAnIteration) * iterations);
  return std::max({kMinSplats, kSplatsAnIteration * iterations, static_cast<int>(kept)});
}

std::string fast_pyramid(const S& s, const Facts& f) {
  S base;
  base.pyramid = static_cast<double>(s.iterations) < kFewUses * static_cast<double>(f.views)
                     ? kPyramidOfFewUses
                 : f.pixels > kLargePixels ? kPyramidOfLarge
                                           : kPyramid;
  std::string text;
  for (const PyramidStep& step : pyramid_steps(base))
    text += fmt::format("{}{}:{:.2g}", text.empty() ? "" : ",", step.factor,
                        fallen(step.share, kPyramidPower, s.iterations));
  return text;
}

int refine_interval(int iterations) { return std::clamp(iterations / kMinRefinements, 1, kRefineEvery); }

// Returns the smallest growth with which the schedule reaches cap_max when the share kGrownAt of the work is
// done.
double fast_growth(S s, const Facts& f) {
  const double first = static_cast<double>(s.refine.first) / kScheduleLength;
  if (first >= kGrownAt || s.refine.empty()) return kGrowth;
  const std::size_t begin = first_splats(s, f);
  const double events =
      std::max(1.0, std::floor((kGrownAt - first) * s.iterations / refine_interval(s.iterations)));
  // Round the growth factor up to four decimals, to keep config.yaml readable. Each refinement rounds the
  // number of splats down, so increase the factor until the schedule reaches cap_max.
  const double ratio = std::max(1.0, s.cap_max / static_cast<double>(begin));
  double steps = std::ceil(std::pow(ratio, 1 / events) * 1e4);
  const auto grown = [&] {
    s.growth = std::min(steps / 1e4, 10.0);
    return s.growth == 10 || Schedule(s, begin).splats_at(kGrownAt) >= static_cast<std::uint32_t>(s.cap_max);
  };
  while (!grown()) ++steps;
  return s.growth;
}

// ---- The table ----

const Field<S> kTrainingFields[] = {
    decided(kSetFirst,
            {"dim",
             "number of dimensions N of a splat: 3 (position), 4 (with time), 6 (with view "
             "direction), 7 (with both); each further query value of the data adds one, up to 11; "
             "auto: the dimensions that differ between the training views",
             &S::dim, 3, 11},
            [](S& s, const S&, const Facts& f) { s.dim = f.dim.dim > 0 ? f.dim.dim : fail_without_data(); }),
    {"rot_mode",
     "how the spatial rotation is computed from its parameters: as I + A with a skew-symmetric matrix A "
     "(taylor1), with the second-order term of exp(A) (taylor2), with the Cayley transform, as exp(A), or "
     "from a quaternion (only with dim = 3)",
     &form<&ModelVariant::rot_mode>, -1, 1, false, variant_values("rot_mode")},
    {"cov_param",
     "parameters of the covariance factor: a spatial rotation and correlations (spatial_ortho), a lower "
     "triangular matrix (cholesky), or a skew-symmetric N x N matrix (skew_nd)",
     &form<&ModelVariant::cov_param>, -1, 1, false, variant_values("cov_param")},
    {"beta_cond", "whether betas below 4 weaken the conditioning on the query (on) or not (off)",
     &form<&ModelVariant::beta_cond>, -1, 1, false, variant_values("beta_cond")},
    {"beta_opacity",
     "how the opacity decreases with the normalised difference y between the query and the mean of a splat: "
     "by the factor (1 - tanh(y_i^2))^beta_i for each dimension i (tanh), not at all (none), or by the "
     "factor exp(-0.35 |y|^2) (gaussian)",
     &form<&ModelVariant::beta_opacity>, -1, 1, false, variant_values("beta_opacity")},
    {"cov_mode", "how the conditional covariance is made symmetric: by its upper triangle, or by whitening",
     &form<&ModelVariant::cov_mode>, -1, 1, false, variant_values("cov_mode")},
    {"kernel", "spatial kernel: (1 - r)^beta, or exp(-r/2) as in 3D Gaussian splatting",
     &form<&ModelVariant::kernel>, -1, 1, false, variant_values("kernel")},
    {"colour",
     "colour model: a constant colour (rgb), spherical harmonics of the view direction (sh and their "
     "degree), or Beta lobes (sb and their number)",
     &form<&ModelVariant::colour>, -1, 1, false, variant_values("colour")},
    {"antialias", "reduce the opacity of small splats to compensate for the blur eps2d",
     &form<&ModelVariant::antialias>, -1, 1, false, variant_values("antialias")},
    decided(0,
            {"conditioning",
             "how splats depend on the query: computed from the covariance of all dimensions (covariance), "
             "or from "
             "separate parameters (direct, docs/method.md 9); auto: direct if dim is auto and the scene is "
             "dynamic",
             &conditioning, -1, 1, false, "auto|covariance|direct"},
            [](S& s, const S& asked, const Facts&) {
              // Direct conditioning is better for dynamic scenes: it increased the PSNR of five of them by
              // 0.5 to 2.4 dB (docs/results/2026-11-22-direct.md).
              const bool direct = asked.dim == kAutoInt && has_time(s.dim) && s.variant == ModelVariant{};
              s.variant.conditioning = direct ? Conditioning::direct : Conditioning::covariance;
              s.conditioning_auto = false;
            }),
    used(kSetFirst, {"schedule",
                     "rules for the automatic values of the schedule: those for runs that are shorter than "
                     "the published ones (fast), or the published values (docs/budget.md)",
                     &choice<S, &S::schedule>, -1, 1, false, "fast|published"}),
    used(kSetFirst | kFreeOnResume, {"budget",
                                     "train for this time, such as 90s, 10m or 1h, instead of a number of "
                                     "iterations; none: no limit; auto: 15m with the schedule fast if the "
                                     "number of iterations is auto, otherwise none (docs/budget.md)",
                                     &S::budget}),
    decided(
        kSetFirst,
        {"iterations",
         "number of optimiser steps; the schedule scales with it; auto: 16000 with the schedule fast, or as "
         "many as the budget allows, otherwise 30000",
         &S::iterations, 1, kMaxIterations},
        [](S& s, const S&, const Facts&) { s.iterations = fast(s) ? kDefaultIterations : kScheduleLength; }),
    {"work_shares",
     "share of the work that is done after some iterations: a list of ITERATION:SHARE, such as "
     "90:0.05,200:0.1; empty: the share is proportional to the iteration. Runs with --budget record their "
     "progress in this setting, so that they can be repeated (docs/budget.md)",
     &S::work_shares},
    {"batch", "number of views per optimiser step", &S::batch, 1, 1024},
    decided(kSetFirst,
            {"cap_max",
             "maximum number of splats; if there are more initial points, some are omitted; auto: 300000; "
             "with the schedule fast, 12 times the number of iterations or the number of initial points up "
             "to 40 times the number of iterations, but from 10000 to 300000",
             &S::cap_max, 1, kMaxSplats},
            [](S& s, const S&, const Facts& f) {
              s.cap_max =
                  fast(s) ? std::min(kPublishedSplats, splats_for(s.iterations, f.points)) : kPublishedSplats;
            }),
    decided(kSetFirst,
            {"init_points",
             "number of random initial splats if the data contain no points, and none are found in the "
             "images; auto: one per three pixels of an image, at most 100000; with the schedule fast, at "
             "most half of cap_max",
             &S::init_points, 1, kMaxSplats},
            [](S& s, const S&, const Facts& f) {
              const auto random = static_cast<int>(f.random_points);
              s.init_points = fast(s) && f.points == 0 ? std::min(s.cap_max / 2, random) : random;
            }),
    decided(kSetFirst,
            {"find_points",
             "number of initial points to triangulate from the images of a static scene; 0: none; auto: "
             "75000, with a budget at most 1000 per second, or 0 if init_points or init_extent is set",
             &S::find_points, 0, kMaxSplats},
            [](S& s, const S& asked, const Facts& f) { s.find_points = points_to_find(asked, f.moves); }),
    used(kSetFirst,
         {"init_extent",
          "place random initial splats in [-init_extent, init_extent]^3; auto: in the space that the cameras "
          "see (docs/data.md)",
          &S::init_extent, kMinLength, kMaxLength, true}),
    decided(
        0,
        {"unit",
         "length in the data that is 1 during training; auto: the median depth of the scene; 1: train in the "
         "unit of the data, as in the published code",
         &S::unit, kMinLength, kMaxLength},
        [](S& s, const S&, const Facts& f) {
          s.unit = f.depth > 0 && has_free_unit(s.variant) ? f.depth : 1;
        }),
    decided(0,
            {"beta_dir_init",
             "initial raw betas of the view direction; auto: -3 with the schedule fast (nearer to 0 in runs "
             "of more than 2000 iterations on static scenes with initial points); otherwise 0, or -3 if N = "
             "7 (but 0 for direct conditioning with beta_opacity none or gaussian)",
             &S::beta_dir_init, -20, 20},
            [](S& s, const S&, const Facts& f) {
              if (!fast(s))
                s.beta_dir_init =
                    s.dim == 7 && s.variant.has_query_beta() && !s.variant.learnt_weights() ? -3 : 0;
              else if (f.points > 0 && !f.plain_background && !has_time(s.dim))
                s.beta_dir_init = falling(s, kFastBetaDir, kDirectionPower);
              else
                s.beta_dir_init = kFastBetaDir;
            }),
    {"beta_query_init", "initial raw betas of time and further query values", &S::beta_query_init, -20, 20},
    used(kSetFirst, {"seed", "seed of all random choices", &S::seed, 0}),
    {"lambda_dssim", "weight of 1 - SSIM in the loss; the weight of the L1 error is 1 - lambda_dssim",
     &S::lambda_dssim, 0, 1},
    decided(
        kOfDrawing | kSetFirst,
        {"background",
         "colour behind the splats and behind transparent pixels, from 0 to 1; auto: the mean colour of the "
         "images if they are opaque, otherwise black; learn: optimise one colour; sky: optimise a colour "
         "per direction; learn and sky require opaque images",
         &S::background, 0, 1},
        [](S& s, const S&, const Facts& f) {
          s.background.automatic = false;
          if (f.opaque()) s.background.colour = f.mean_colour;
        }),
    decided(
        0,
        {"random_background",
         "train each view with a different random background colour, so that splats become as opaque as the "
         "images; auto: on if all images are opaque and no background is learnt",
         &choice<S, &S::random_background>, -1, 1, false, "auto|off|on"},
        [](S& s, const S&, const Facts& f) {
          const bool colour = s.background.learnt == Background::Learnt::no && s.background.harmonics.empty();
          s.random_background = f.opaque() && colour ? RandomBackground::on : RandomBackground::off;
        }),
    decided(0,
            {"opacity_reg",
             "weight of the mean opacity in the loss; auto: 0.01, or 0 for wide images; with the schedule "
             "fast, 0.02 for few photographs, and 0 with random backgrounds",
             &S::opacity_reg, 0, 1e3},
            [](S& s, const S&, const Facts& f) {
              s.opacity_reg = f.wide_images                                 ? kWideOpacityReg
                              : !fast(s)                                    ? kOpacityReg
                              : f.few_images                                ? kFewOpacityReg
                              : s.random_background == RandomBackground::on ? kOpaqueOpacityReg
                                                                            : kOpacityReg;
            }),
    {"scale_penalty", "weight of the mean spatial scale in the loss", &S::scale_penalty, 0, 1e3},
    decided(0,
            {"pyramid",
             "train on reduced images first: a list of reduction factors, each with the share of the work up "
             "to which it is used, such as 4:0.2,2:0.5; empty: always use full-size images; auto: "
             "4:0.5,2:0.8 with the schedule fast (smaller shares in runs of more than 2000 iterations, "
             "larger ones for large or many images), otherwise empty",
             &S::pyramid},
            [](S& s, const S&, const Facts& f) { s.pyramid = fast(s) ? fast_pyramid(s, f) : ""; }),
    decided(0,
            {"refine",
             "when splats are relocated and added, as FIRST:END:STEP: every STEP iterations, after iteration "
             "FIRST and before iteration END. The numbers are for a run of 30000 iterations, and scale with "
             "iterations; 0:0:1: never; auto: 500:25000:100; with the schedule fast, the number for STEP is "
             "chosen so that splats are refined every 100 iterations, but at least 10 times",
             &S::refine, 0, 30000},
            [](S& s, const S&, const Facts&) {
              s.refine = {500, 25000, 100};
              if (fast(s))
                s.refine.step = std::min(kScheduleLength,
                                         static_cast<int>(std::llround(1.0 * refine_interval(s.iterations) *
                                                                       kScheduleLength / s.iterations)));
            }),
    decided(0,
            {"growth",
             "ratio of the numbers of splats after and before a refinement; auto: 1.02; with the schedule "
             "fast, so that the number of splats reaches cap_max when half of the work is done",
             &S::growth, 1, 10},
            [](S& s, const S&, const Facts& f) { s.growth = fast(s) ? fast_growth(s, f) : kGrowth; }),
    {"growth_end",
     "share of the work after which no splats are added. A run with --budget reduces and records it if its "
     "time is too short for more splats",
     &S::growth_end, 0, 1},
    decided(
        0,
        {"copy_spread",
         "random displacement of a copy when splats are relocated and added, in units of its scales. The "
         "scales of both are multiplied by 1 / sqrt(1 + copy_spread^2). 0: copies are equal to their "
         "sources, as published; auto: 0.35 with the schedule fast, but 0 if the shape of splats is frozen; "
         "otherwise 0",
         &S::copy_spread, 0, 10},
        [](S& s, const S&, const Facts&) { s.copy_spread = fast(s) && !freezes_shape(s) ? kCopySpread : 0; }),
    decided(0,
            {"noise_lr",
             "factor of the random noise that is added to positions; auto: 1 for dynamic scenes, 1e6 for "
             "static ones, but 1.6e7 with the schedule published if unit is auto",
             &S::noise_lr, 0, 1e12},
            [](S& s, const S& asked, const Facts& f) {
              const bool published =
                  !fast(s) && asked.unit == kAuto && f.depth > 0 && has_free_unit(s.variant);
              s.noise_lr = has_time(s.dim) ? 1 : published ? kNoiseOfDepth : kNoise;
            }),
    {"appearance",
     "optimise exposure and white balance of each training image: not at all (none), as a gain per channel, "
     "or as an affine map of colours",
     &choice<S, &S::appearance>, -1, 1, false, "none|gain|affine"},
    {"refine_cameras",
     "optimise the cameras of the training views: not at all (none), only their poses, or also their focal "
     "lengths and principal points",
     &choice<S, &S::refine_cameras>, -1, 1, false, "none|pose|pose+intrinsics"},
    {"lr_batch",
     "how learning rates depend on the number of views per step: not at all (none), or multiplied by its "
     "square root (docs/cluster.md)",
     &choice<S, &S::lr_batch>, -1, 1, false, "none|sqrt"},
    decided(
        0,
        {"lr_cooldown",
         "share of the work, at the end of training, over which all learning rates decrease linearly to 0; "
         "auto: 0.15 with the schedule fast, or 0.6 for dynamic scenes with direct conditioning; otherwise 0",
         &S::lr_cooldown, 0, 1},
        [](S& s, const S&, const Facts&) {
          s.lr_cooldown = !fast(s) ? 0 : has_time(s.dim) && s.variant.direct() ? kMovingCooldown : kCooldown;
        }),
    decided(
        0,
        {"lr_xyz",
         "initial learning rate of positions, relative to the scene extent; auto: 1.6e-4; with the schedule "
         "fast, 5 divided by the number of iterations, at most 3e-3, if splats start at random positions",
         &S::lr_xyz, kMinDecayingRate, 10},
        [](S& s, const S&, const Facts& f) {
          s.lr_xyz = fast(s) && f.points == 0
                         ? std::clamp(kFarTravel / s.iterations, kRateOfPositions, kFastest)
                         : kRateOfPositions;
        }),
    decided(
        0,
        {"lr_xyz_final",
         "final learning rate of positions, relative to the scene extent; "
         "auto: 4e-5 with the schedule fast (less in runs of more than 2000 iterations), otherwise 1.6e-6",
         &S::lr_xyz_final, kMinDecayingRate, 10},
        [](S& s, const S&, const Facts&) { s.lr_xyz_final = fast(s) ? falling(s, 4e-5, 1.6) : 1.6e-6; }),
    decided(0,
            {"lr_mean",
             "learning rate of query means; "
             "auto: 0.005 with the schedule fast (less in runs of more than 2000 iterations), otherwise 1e-3",
             &S::lr_mean, 0, 10},
            [](S& s, const S&, const Facts&) { s.lr_mean = fast(s) ? falling(s, 0.005, 0.35) : 1e-3; }),
    decided(0,
            {"lr_rgb",
             "learning rate of colours. The rate of harmonics other than the constant term is a twentieth of "
             "this; "
             "auto: 0.005 with the schedule fast (less in runs of more than 2000 iterations), otherwise "
             "0.001, or 0.0025 for spherical harmonics and Beta lobes",
             &S::lr_rgb, 0, 10},
            [](S& s, const S&, const Facts&) {
              s.lr_rgb = fast(s)                               ? falling(s, 0.005, 0.35)
                         : s.variant.colour == ColourMode::rgb ? 1e-3
                                                               : 2.5e-3;
            }),
    decided(0,
            {"lr_opacity", "learning rate of raw opacities; auto: 0.05, or 0.025 with kernel gaussian",
             &S::lr_opacity, 0, 10},
            [](S& s, const S&, const Facts&) { s.lr_opacity = row_of(s.variant.kernel).lr_opacity; }),
    decided(0,
            {"lr_beta",
             "learning rate of raw betas; "
             "auto: 0.01 with the schedule fast (less in runs of more than 2000 iterations), otherwise 1e-3",
             &S::lr_beta, 0, 10},
            [](S& s, const S&, const Facts&) { s.lr_beta = fast(s) ? falling(s, 0.01, 0.6) : 1e-3; }),
    decided(0,
            {"lr_scale",
             "learning rate of raw scales; "
             "auto: 0.02 with the schedule fast (less in runs of more than 2000 iterations), otherwise "
             "0.005, or 0.02 with kernel gaussian",
             &S::lr_scale, 0, 10},
            [](S& s, const S&, const Facts&) {
              s.lr_scale = fast(s) ? falling(s, 0.02, 0.35) : row_of(s.variant.kernel).lr_scale;
            }),
    decided(0,
            {"lr_l_triangle",
             "learning rate of rotation and correlation entries; "
             "auto: 0.005 with the schedule fast (less in runs of more than 2000 iterations), otherwise 1e-3",
             &S::lr_l_triangle, 0, 10},
            [](S& s, const S&, const Facts&) { s.lr_l_triangle = fast(s) ? falling(s, 0.005, 0.35) : 1e-3; }),
    used(kOfDrawing, {"eps2d", "blur added to the projected support ellipse [px^2]", &S::eps2d, 0, 100}),
    decided(kOfDrawing,
            {"near_plane", "splats nearer than this are not rendered; auto: 0.01 times `unit`",
             &S::near_plane, kMinLength, kMaxLength},
            [](S& s, const S&, const Facts&) { s.near_plane = planes_of(s).near; }),
    decided(kOfDrawing,
            {"far_plane", "splats farther than this are not rendered; auto: 1e10 times `unit`", &S::far_plane,
             kMinLength, kMaxLength},
            [](S& s, const S&, const Facts&) { s.far_plane = planes_of(s).far; }),
    used(kOfKernels, {"query_grad", "also compute the gradient through the view direction", &S::query_grad}),
    {"raster",
     "rasteriser: a work-item renders a block of pixels (cpu) or one pixel (gpu); auto: cpu on devices with "
     "wide vectors",
     &S::raster, -1, 1, false, "auto|cpu|gpu"},
    used(kOfKernels | kOfDrawing | kSetFirst,
         {"alpha_min", "skip a splat in pixels where its alpha is this value or less; 0: never skip",
          &S::alpha_min, 0, 0.5}),
    used(kOfKernels, {"freeze", "parameter groups that are not trained, such as xyz,rgb", &S::freeze}),
    used(kOfKernels,
         {"math",
          "accuracy of powers in the kernels: exact, native or rough, with relative errors of 1e-7, 1e-5 and "
          "4e-4",
          &choice<S, &S::math>, -1, 1, false, "exact|native|rough"}),
};

const Field<S> kOutputFields[] = {
    used(kFreeOnResume | kSetFirst,
         {"eval_every",
          "interval between evaluations on the test split, in iterations (500) or seconds (30s); 0: only at "
          "the end. If it is not set, a few test views are also evaluated during training",
          &S::eval_every}),
    used(kFreeOnResume,
         {"save_renders", "number of test views saved with their ground truth at the end; -1: all",
          &S::save_renders, -1, 1'000'000}),
    {"log_every", "number of iterations between rows of log.csv", &S::log_every, 1, kMaxIterations},
    used(kFreeOnResume, {"checkpoint_every",
                         "interval between checkpoints, in iterations (500) or seconds (300s); 0: write one "
                         "only when training is interrupted",
                         &S::checkpoint_every}),
    used(kFreeOnResume,
         {"on_nan",
          "what to do when values are not finite: stop, return to the last checkpoint (rollback), remove the "
          "affected splats (drop), or do not check (off)",
          &choice<S, &S::on_nan>, -1, 1, false, "stop|rollback|drop|off"}),
};

}  // namespace

std::span<const Field<TrainSettings>> train_fields() {
  static const std::vector<Field<S>> fields = [] {
    std::vector<Field<S>> all(std::begin(kTrainingFields), std::end(kTrainingFields));
    std::ranges::copy(read_fields<S>(), std::back_inserter(all));
    std::ranges::copy(kOutputFields, std::back_inserter(all));
    return all;
  }();
  return fields;
}

std::vector<std::string_view> keys_used(unsigned uses) {
  std::vector<std::string_view> keys;
  for (const Field<S>& field : train_fields())
    if (field.uses & uses) keys.emplace_back(field.key);
  return keys;
}

}  // namespace ubs
