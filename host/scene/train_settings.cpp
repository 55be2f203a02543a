// SPDX-License-Identifier: Apache-2.0
// This file contains the table of training fields: key, help and range of each, in the order of --help and
// config.yaml.
#include "host/scene/train_settings.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "host/base/error.hpp"
#include "host/scene/frozen_groups.hpp"

namespace ubs {
namespace {

using S = TrainSettings;

constexpr int kMaxSplats = 100'000'000;     // far more than any device can hold; catches typing errors
constexpr double kMinDecayingRate = 1e-30;  // an exponential decay cannot reach 0; this rate has no effect
constexpr int kMaxIterations = 10'000'000;  // catches typing errors too
constexpr int kMaxPyramidFactor = 64;
constexpr double kMinLength = 1e-20, kMaxLength = 1e30;  // their squares are finite in single precision
constexpr double kMinAlphaMin = 1e-6;  // kernels/math/reach.h is derived for values from here on

template <auto Switch>
ChoiceRef form(S& settings) {
  return choice<ModelVariant, Switch>(settings.variant);
}

// The choice `auto`, followed by the kinds of conditioning.
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

constexpr Field<S> used(unsigned uses, Field<S> field) {
  field.uses = uses;
  return field;
}

const Field<S> kFields[] = {
    used(kSetFirst, {"dim",
                     "number of dimensions N of a splat: 3, 4 (with time), 6 (with view direction), 7 (with "
                     "both), more with further query values; auto: those that differ between the training "
                     "views",
                     &S::dim, 3, 11, true}),
    used(kSetFirst,
         {"init_points",
          "number of random initial splats if the data contain no points; auto: triangulate points from the "
          "images, or if that fails, one splat per three pixels of an image, at most 100000",
          &S::init_points, 1, kMaxSplats, true}),
    used(kSetFirst, {"find_points",
                     "number of initial points to find by comparing the images of a still scene; 0: none. "
                     "Fewer points take "
                     "less time, and --budget chooses fewer for short budgets",
                     &S::find_points, 0, kMaxSplats}),
    used(kSetFirst,
         {"init_extent",
          "place random initial splats in [-init_extent, init_extent]^3; auto: in the space that the cameras "
          "see (docs/data.md)",
          &S::init_extent, kMinLength, kMaxLength, true}),
    used(kSetFirst, {"cap_max", "maximum number of splats; a larger number of initial points is reduced",
                     &S::cap_max, 1, kMaxSplats}),
    {"unit",
     "length in the unit of the data that is 1 during training; auto: the median depth of the scene; 1: "
     "train in the unit of the data, as published",
     &S::unit, kMinLength, kMaxLength, true},
    {"beta_dir_init", "raw initial direction betas; auto: 0, or -3 for N = 7", &S::beta_dir_init, -20, 20,
     true},
    {"beta_query_init", "raw initial betas of time and further query values", &S::beta_query_init, -20, 20},
    used(kSetFirst, {"seed", "seed of all random choices", &S::seed, 0}),

    {"rot_mode",
     "parameters of the spatial rotation: I + A (taylor1), its second-order version, the Cayley transform, "
     "the exponential, or a quaternion (only with dim 3)",
     &form<&ModelVariant::rot_mode>, -1, 1, false, variant_values("rot_mode")},
    {"cov_param",
     "parameters of the covariance factor: a spatial rotation and correlations (spatial_ortho), a lower "
     "triangle (cholesky), or a skew N x N matrix (skew_nd)",
     &form<&ModelVariant::cov_param>, -1, 1, false, variant_values("cov_param")},
    {"beta_cond", "on: betas below 1 weaken the conditioning on the query; off: they do not",
     &form<&ModelVariant::beta_cond>, -1, 1, false, variant_values("beta_cond")},
    {"beta_opacity", "opacity at the query: (1 - tanh)^beta, unchanged, or exp(-0.35 y.y)",
     &form<&ModelVariant::beta_opacity>, -1, 1, false, variant_values("beta_opacity")},
    {"cov_mode", "asymmetric conditional covariance: upper triangle, or whitened weights",
     &form<&ModelVariant::cov_mode>, -1, 1, false, variant_values("cov_mode")},
    {"kernel", "spatial kernel: (1 - r)^beta, or exp(-r/2) as in 3D Gaussian splatting",
     &form<&ModelVariant::kernel>, -1, 1, false, variant_values("kernel")},
    {"colour",
     "colour model: constant, spherical harmonics of the view direction (sh and their degree), or Beta lobes "
     "(sb and their number)",
     &form<&ModelVariant::colour>, -1, 1, false, variant_values("colour")},
    {"antialias", "reduce the opacity of small splats to compensate for the blur eps2d",
     &form<&ModelVariant::antialias>, -1, 1, false, variant_values("antialias")},
    {"conditioning",
     "conditioning on the query: computed from the covariance of all dimensions, or direct, from separate "
     "parameters (docs/method.md 9); auto: direct if dim is auto and the scene is dynamic",
     &conditioning, -1, 1, false, "auto|covariance|direct"},

    used(kSetFirst, {"iterations", "number of optimiser steps; the schedule scales with it", &S::iterations,
                     1, kMaxIterations}),
    {"work_shares",
     "share of the work that is done after certain iterations, as recorded by --budget: "
     "ITERATION:SHARE,..., such as 90:0.05,200:0.1; empty: proportional to the iterations; @ITERATION after "
     "a point: the pace changed after this earlier iteration",
     &S::work_shares},
    {"batch", "number of views per step", &S::batch, 1, 1024},
    {"pyramid",
     "train on reduced images first: reduction factors, and the share of the work up to which each is used, "
     "such as 4:0.2,2:0.5; empty: always use full-size images",
     &S::pyramid},
    {"refine", "refine every STEP iterations, after iteration FIRST and before END (of 30 000); 0:0:1: never",
     &S::refine, 0, 30000},
    {"growth", "ratio of the numbers of splats after and before a refinement", &S::growth, 1, 10},
    {"growth_end",
     "share of the work after which no splats are added, as recorded by --budget if there is too little time",
     &S::growth_end, 0, 1},
    {"noise_lr",
     "factor of the position noise; auto: 1 for dynamic scenes; for static scenes 1.6e7, or 1e6 if unit is "
     "a number",
     &S::noise_lr, 0, 1e12, true},

    {"lambda_dssim", "weight of 1 - SSIM in the loss; the weight of L1 is 1 minus this", &S::lambda_dssim, 0,
     1},
    {"opacity_reg", "weight of the mean opacity in the loss", &S::opacity_reg, 0, 1e3},
    {"scale_penalty", "weight of the mean spatial scale in the loss", &S::scale_penalty, 0, 1e3},
    used(kOfDrawing | kSetFirst,
         {"background",
          "colour behind the splats and behind transparent pixels, from 0 to 1; auto: the mean colour of "
          "opaque images, otherwise black; learn: optimise one colour; sky: optimise a colour per direction "
          "(both require opaque images)",
          &S::background, 0, 1}),
    {"random_background",
     "train each view with a different random background colour, so that splats become as opaque as the "
     "images; auto: on if all images are opaque and no background is learnt",
     &choice<S, &S::random_background>, -1, 1, false, "auto|off|on"},
    {"appearance",
     "optimise exposure and white balance of each training image: a gain per channel, or an affine colour "
     "map",
     &choice<S, &S::appearance>, -1, 1, false, "none|gain|affine"},
    {"refine_cameras",
     "also optimise the poses of the training views, or their poses, focal lengths and principal points",
     &choice<S, &S::refine_cameras>, -1, 1, false, "none|pose|pose+intrinsics"},

    {"lr_batch",
     "learning rates of batches with several views: unchanged, or multiplied by the square root of the "
     "number of views per step (docs/cluster.md)",
     &choice<S, &S::lr_batch>, -1, 1, false, "none|sqrt"},
    {"lr_cooldown",
     "share of the work, at the end of training, over which all learning rates decrease linearly to 0",
     &S::lr_cooldown, 0, 1},
    {"lr_xyz", "initial learning rate of positions, times the scene extent", &S::lr_xyz, kMinDecayingRate,
     10},
    {"lr_xyz_final", "final learning rate of positions, times the scene extent", &S::lr_xyz_final,
     kMinDecayingRate, 10},
    {"lr_mean", "learning rate of query means", &S::lr_mean, 0, 10},
    {"lr_rgb",
     "learning rate of colours; auto: 0.001, or 0.0025 for spherical harmonics and Beta lobes. Harmonics "
     "other than the constant term have a twentieth of it",
     &S::lr_rgb, 0, 10, true},
    {"lr_opacity", "learning rate of raw opacities; auto: 0.05, or 0.025 with kernel gaussian",
     &S::lr_opacity, 0, 10, true},
    {"lr_beta", "learning rate of raw betas", &S::lr_beta, 0, 10},
    {"lr_scale", "learning rate of raw scales; auto: 0.005, or 0.02 with kernel gaussian", &S::lr_scale, 0,
     10, true},
    {"lr_l_triangle", "learning rate of rotation and correlation entries", &S::lr_l_triangle, 0, 10},

    used(kOfDrawing, {"eps2d", "blur added to the projected support ellipse [px^2]", &S::eps2d, 0, 100}),
    used(kOfDrawing, {"near_plane", "splats nearer than this are not rendered; auto: 0.01 units",
                      &S::near_plane, kMinLength, kMaxLength, true}),
    used(kOfDrawing, {"far_plane", "splats farther than this are not rendered; auto: 1e10 units",
                      &S::far_plane, kMinLength, kMaxLength, true}),
    used(kOfKernels, {"query_grad", "also compute the gradient through the view direction", &S::query_grad}),
    {"raster",
     "rasteriser: blocks of pixels (cpu) or one work-item per pixel (gpu); auto: cpu on devices with wide "
     "vectors",
     &S::raster, -1, 1, false, "auto|cpu|gpu"},

    used(kOfKernels | kOfDrawing | kSetFirst,
         {"alpha_min", "skip a splat in pixels where its alpha is not above this value; 0: never",
          &S::alpha_min, 0, 0.5}),
    used(kOfKernels, {"freeze", "parameter groups that are not trained, such as xyz,rgb", &S::freeze}),
    used(kOfKernels,
         {"math",
          "accuracy of powers in the kernels: exact, native or rough (relative errors 1e-7, 1e-5, 4e-4)",
          &choice<S, &S::math>, -1, 1, false, "exact|native|rough"}),

    used(kOfReading | kSetFirst, {"downscale", "reduce images by this factor on load", &S::downscale, 1, 64}),
    used(kOfReading,
         {"layout", "layout of the data (docs/data.md); auto: recognised by their contents", &S::layout}),
    used(kOfReading, {"images", "folder of images inside a COLMAP or LLFF folder; auto: images", &S::images}),
    used(kOfReading,
         {"colmap_model",
          "name of the folder in sparse/ that contains the COLMAP model; auto: the one with the most images",
          &S::colmap_model}),
    used(kOfReading,
         {"principal_point",
          "principal point of the cameras: that of the data, or the centre of the image, as published",
          &choice<S, &S::principal_point>, -1, 1, false, "true|centre"}),
    used(kOfReading | kSetFirst, {"test_every",
                                  "every n-th view by name is a test view (COLMAP, LLFF, nerfstudio); 0: "
                                  "none; auto: 8, but views that lie between others if there are fewer than "
                                  "24 images (docs/data.md)",
                                  &S::test_every, 0, 1'000'000, true}),
    used(kFreeOnResume,
         {"image_cache_mb", "memory for images [MB]; if they need more, they are decoded when needed",
          &S::image_cache_mb, 1, 1 << 20}),
    used(kFreeOnResume | kOfReading,
         {"cache_folder", "folder in which undistorted images and video frames are kept; empty: none",
          &S::cache_folder}),
    used(kFreeOnResume | kOfReading,
         {"allow_outside",
          "allow links, absolute paths and .. in the data to refer to files outside of the data folder",
          &S::allow_outside}),
    used(kOfReading,
         {"frames", "frames of videos to use, FIRST:END:STEP, such as 0:300 or 0:300:2; empty: all",
          &S::frames, 0, kMaxIterations, true}),
    used(
        kFreeOnResume | kSetFirst,
        {"eval_every",
         "iterations (500) or seconds (30s) between evaluations on the test split; 0: only at the end; if it "
         "is not set, a few test views are also measured in between",
         &S::eval_every}),
    used(kFreeOnResume,
         {"save_renders", "number of test views saved next to their ground truth at the end; -1: all",
          &S::save_renders, -1, 1'000'000}),
    {"log_every", "number of iterations between rows of log.csv", &S::log_every, 1, kMaxIterations},
    used(kFreeOnResume, {"checkpoint_every",
                         "iterations (500) or seconds (300s) between checkpoints; 0: only when interrupted",
                         &S::checkpoint_every}),
    used(kFreeOnResume,
         {"on_nan",
          "reaction to values that are not finite: stop, roll back to the last checkpoint, drop the affected "
          "splats, or off: do not check",
          &choice<S, &S::on_nan>, -1, 1, false, "stop|rollback|drop|off"}),
};

}  // namespace

std::span<const Field<TrainSettings>> train_fields() { return kFields; }

// Throws Error(usage) if refinements would change a frozen group: relocation moves splats and reduces the
// opacity of the splats that it copies. It copies other groups without changing them.
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
         "random_background = on does not support a background that is learnt, or a sky: choose a colour");
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

// Reads a number from the front of the text, and the character that must follow it.
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
    const bool goes_on = last.share == 1 && point.share < 1;  // a finished run that was continued
    if (!read || point.iteration <= last.iteration || !(point.share > last.share || goes_on) ||
        !(point.share <= 1) ||
        (left && (point.left_at <= last.iteration || point.left_at >= point.iteration)))
      fail(ErrorKind::usage,
           "work_shares must be empty, or a list of increasing iterations and increasing shares of the work "
           "that is done after them, such as 90:0.05,200:0.1; the first invalid entry follows '{}:{}'",
           last.iteration, last.share);
    points.push_back(point);
    last = reached(last, point);
  }
  if (points.empty()) return points;
  if (last.iteration > s.iterations || (last.share == 1) != (last.iteration == s.iterations))
    fail(ErrorKind::usage,
         "work_shares depends on the number of iterations: a share of {} after iteration {} does not match a "
         "run of {} iterations: pass both settings, or neither",
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
           "pyramid = '{}' must be empty, or a list of falling factors from {} to 2, each with the share "
           "of the iterations at which it ends, such as 4:0.2,2:0.5",
           s.pyramid, kMaxPyramidFactor);
    steps.push_back(step);
  }
  return steps;
}

}  // namespace ubs
