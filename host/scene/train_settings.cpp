// SPDX-License-Identifier: Apache-2.0
// This file contains the table of the training fields, except for those of read_settings.hpp. It has the key,
// the help text and the range of each field, in the order in which --help and config.yaml list them.
#include "host/scene/train_settings.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>

#include "host/base/error.hpp"
#include "host/scene/frozen_groups.hpp"

namespace ubs {
namespace {

using S = TrainSettings;

constexpr int kMaxSplats = 100'000'000;     // far more than useful models have; catches typing errors
constexpr double kMinDecayingRate = 1e-30;  // the decay cannot reach 0; a rate this small has no effect
constexpr int kMaxIterations = 10'000'000;  // also catches typing errors
constexpr int kMaxPyramidFactor = 64;
constexpr double kMinLength = 1e-20, kMaxLength = 1e30;  // both are in the range of single precision
constexpr double kMinAlphaMin = 1e-6;  // kernels/math/reach.h does not support smaller values

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

const Field<S> kTrainingFields[] = {
    used(kSetFirst, {"dim",
                     "number of dimensions N of a splat: 3 (position), 4 (with time), 6 (with view "
                     "direction), 7 (with both); each further query value of the data adds one, up to 11; "
                     "auto: the dimensions that differ between the training views",
                     &S::dim, 3, 11, true}),
    used(kSetFirst,
         {"init_points",
          "number of random initial splats if the data contain no points; auto: triangulate points from the "
          "images, or if that fails, one splat per three pixels of an image, at most 100000",
          &S::init_points, 1, kMaxSplats, true}),
    used(kSetFirst, {"find_points",
                     "number of initial points to triangulate from the images of a static scene; 0: none. "
                     "Fewer points take less time, so the default is lower with a short --budget",
                     &S::find_points, 0, kMaxSplats}),
    used(kSetFirst,
         {"init_extent",
          "place random initial splats in [-init_extent, init_extent]^3; auto: in the space that the cameras "
          "see (docs/data.md)",
          &S::init_extent, kMinLength, kMaxLength, true}),
    used(kSetFirst,
         {"cap_max", "maximum number of splats; if there are more initial points, some are omitted",
          &S::cap_max, 1, kMaxSplats}),
    {"unit",
     "length in the data that is 1 during training; auto: the median depth of the scene; 1: train in the "
     "unit of the data, as in the published code",
     &S::unit, kMinLength, kMaxLength, true},
    {"beta_dir_init",
     "initial raw betas of the view direction; auto: 0, or -3 if N = 7 (but 0 for direct conditioning with "
     "beta_opacity none or gaussian)",
     &S::beta_dir_init, -20, 20, true},
    {"beta_query_init", "initial raw betas of time and further query values", &S::beta_query_init, -20, 20},
    used(kSetFirst, {"seed", "seed of all random choices", &S::seed, 0}),

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
    {"conditioning",
     "how splats depend on the query: computed from the covariance of all dimensions (covariance), or from "
     "separate parameters (direct, docs/method.md 9); auto: direct if dim is auto and the scene is dynamic",
     &conditioning, -1, 1, false, "auto|covariance|direct"},

    used(kSetFirst, {"iterations", "number of optimiser steps; the schedule scales with it", &S::iterations,
                     1, kMaxIterations}),
    {"work_shares",
     "share of the work that is done after some iterations: a list of ITERATION:SHARE, such as "
     "90:0.05,200:0.1; empty: the share is proportional to the iteration. Runs with --budget record their "
     "progress in this setting, so that they can be repeated (docs/budget.md)",
     &S::work_shares},
    {"batch", "number of views per optimiser step", &S::batch, 1, 1024},
    {"pyramid",
     "train on reduced images first: a list of reduction factors, each with the share of the work up to "
     "which it is used, such as 4:0.2,2:0.5; empty: always use full-size images",
     &S::pyramid},
    {"refine",
     "when splats are relocated and added, as FIRST:END:STEP: every STEP iterations, after iteration FIRST "
     "and before iteration END. The numbers are for a run of 30000 iterations, and scale with iterations; "
     "0:0:1: never",
     &S::refine, 0, 30000},
    {"growth", "ratio of the numbers of splats after and before a refinement", &S::growth, 1, 10},
    {"growth_end",
     "share of the work after which no splats are added. A run with --budget reduces and records it if its "
     "time is too short for more splats",
     &S::growth_end, 0, 1},
    {"noise_lr",
     "factor of the random noise that is added to positions; auto: 1 for dynamic scenes; for static scenes "
     "1.6e7, or 1e6 if unit is not auto",
     &S::noise_lr, 0, 1e12, true},

    {"lambda_dssim", "weight of 1 - SSIM in the loss; the weight of the L1 error is 1 - lambda_dssim",
     &S::lambda_dssim, 0, 1},
    {"opacity_reg", "weight of the mean opacity in the loss", &S::opacity_reg, 0, 1e3},
    {"scale_penalty", "weight of the mean spatial scale in the loss", &S::scale_penalty, 0, 1e3},
    used(kOfDrawing | kSetFirst,
         {"background",
          "colour behind the splats and behind transparent pixels, from 0 to 1; auto: the mean colour of the "
          "images if they are opaque, otherwise black; learn: optimise one colour; sky: optimise a colour "
          "per direction; learn and sky require opaque images",
          &S::background, 0, 1}),
    {"random_background",
     "train each view with a different random background colour, so that splats become as opaque as the "
     "images; auto: on if all images are opaque and no background is learnt",
     &choice<S, &S::random_background>, -1, 1, false, "auto|off|on"},
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
    {"lr_cooldown",
     "share of the work, at the end of training, over which all learning rates decrease linearly to 0",
     &S::lr_cooldown, 0, 1},
    {"lr_xyz", "initial learning rate of positions, relative to the scene extent", &S::lr_xyz,
     kMinDecayingRate, 10},
    {"lr_xyz_final", "final learning rate of positions, relative to the scene extent", &S::lr_xyz_final,
     kMinDecayingRate, 10},
    {"lr_mean", "learning rate of query means", &S::lr_mean, 0, 10},
    {"lr_rgb",
     "learning rate of colours; auto: 0.001, or 0.0025 for spherical harmonics and Beta lobes. The rate of "
     "harmonics other than the constant term is a twentieth of this",
     &S::lr_rgb, 0, 10, true},
    {"lr_opacity", "learning rate of raw opacities; auto: 0.05, or 0.025 with kernel gaussian",
     &S::lr_opacity, 0, 10, true},
    {"lr_beta", "learning rate of raw betas", &S::lr_beta, 0, 10},
    {"lr_scale", "learning rate of raw scales; auto: 0.005, or 0.02 with kernel gaussian", &S::lr_scale, 0,
     10, true},
    {"lr_l_triangle", "learning rate of rotation and correlation entries", &S::lr_l_triangle, 0, 10},

    used(kOfDrawing, {"eps2d", "blur added to the projected support ellipse [px^2]", &S::eps2d, 0, 100}),
    used(kOfDrawing, {"near_plane", "splats nearer than this are not rendered; auto: 0.01 times `unit`",
                      &S::near_plane, kMinLength, kMaxLength, true}),
    used(kOfDrawing, {"far_plane", "splats farther than this are not rendered; auto: 1e10 times `unit`",
                      &S::far_plane, kMinLength, kMaxLength, true}),
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

// Throws Error(usage) if refinements would change a frozen group: relocation moves splats and reduces the
// opacity of the splats that it copies. The other groups are copied without changes.
void check_freeze(const TrainSettings& s) {
  const std::uint32_t frozen = frozen_groups(ParameterLayout(s.dim, s.variant), s.freeze);
  for (const char* group : {"xyz", "opacity"})
    if (is_frozen(frozen, group) && !s.refine.empty())
      fail(ErrorKind::usage,
           "freeze = '{}': relocation and growth would change {}: disable them with refine = 0:0:1", s.freeze,
           group);
}

std::vector<std::string_view> keys_used(unsigned uses) {
  std::vector<std::string_view> keys;
  for (const Field<S>& field : train_fields())
    if (field.uses & uses) keys.emplace_back(field.key);
  return keys;
}

Planes planes_of(const TrainSettings& s) {
  const double unit = s.unit == kAuto ? 1 : s.unit;
  return {s.near_plane == kAuto ? 0.01 * unit : s.near_plane,
          s.far_plane == kAuto ? 1e10 * unit : s.far_plane};
}

void validate(const TrainSettings& s) {
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
  if (s.refine.first > s.refine.end || s.refine.step < 1)
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
  if (points.empty()) return points;
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
