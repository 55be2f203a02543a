// SPDX-License-Identifier: Apache-2.0
// TrainSettings holds the settings of a training run as somebody asks for them. Many are automatic by
// default: settle() (settle.hpp) replaces them by values that depend on other settings and on the data, and
// returns a Plan, which is what a training uses. The rows of the table of fields (train_fields) contain the
// rules for these values. Command line options, YAML keys, --set and config.yaml are all generated from this
// table.
#pragma once

#include <cstdint>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/background.hpp"
#include "host/base/index_range.hpp"
#include "host/scene/appearance_kind.hpp"
#include "host/scene/math_mode.hpp"
#include "host/scene/model_variant.hpp"
#include "host/settings/field.hpp"
#include "host/settings/read_settings.hpp"

namespace ubs {

// Number of iterations of the run to which the iteration numbers in `refine` and other settings refer.
inline constexpr int kScheduleLength = 30000;
// If neither a number of iterations nor a budget is given, a run with the schedule fast ends after this many
// iterations or this many seconds, whichever comes first. This number of iterations reaches the published
// quality (docs/results/2026-11-22-long-schedules.md).
inline constexpr int kDefaultIterations = 16000;
inline constexpr double kDefaultSeconds = 900;

enum class RefineCameras { none, pose, pose_and_intrinsics };
enum class RandomBackground { automatic, off, on };
enum class ListCounts { automatic, wait, bound };
enum class BatchRates { none, sqrt };
enum class OnNan { stop, rollback, drop, off };
// Which rules determine the automatic values of the schedule: those for runs that are shorter than the
// published ones, or the published values (method.md 4).
enum class ScheduleKind { fast, published };

// In each enumeration, the enumerators are in the order of their words in the table of fields.
struct TrainSettings : ReadSettings {
  // Model
  int dim = kAutoInt;          // 3, 4 (with time), 6 (with direction), 7 (with both), ..., 11, or kAutoInt
  int init_points = kAutoInt;  // number of random initial splats if there are no points
  // Random initial splats are in [-init_extent, init_extent]^3; auto: in the space that the cameras see.
  double init_extent = kAuto;
  int cap_max = kAutoInt;        // maximum number of splats, also of initial ones
  int find_points = kAutoInt;    // number of initial points to triangulate from the images; 0: none
  double beta_dir_init = kAuto;  // initial raw betas of the direction; auto: see InitOptions::beta_dir
  double beta_query_init = 0;    // initial raw betas of time and further query values
  double unit = kAuto;           // unit of length in training, in units of the data (scene_unit.hpp)
  std::uint64_t seed = 42;

  // Variant of the method (docs/variants.md); recorded in the model file
  ModelVariant variant;
  bool conditioning_auto = true;  // whether variant.conditioning will be chosen from the data

  // Schedule. Iteration numbers refer to a run of 30 000 iterations and scale with `iterations`.
  ScheduleKind schedule{};
  std::string budget = "auto";  // maximum time such as 90s, 10m or 1h; none; budget_seconds() parses it
  int iterations = kAutoInt;
  int batch = 1;  // number of views per optimiser step
  // Share of the work that is done after some iterations, such as 90:0.05,200:0.1
  // (host/settings/work_share.hpp). If it is empty, the share is proportional to the iteration. 200:0.1@120
  // means that the run was to reach the share 0.1 after iteration 200, but changed its pace after iteration
  // 120.
  std::string work_shares;
  // Use of reduced images, such as 4:0.2,2:0.5 (docs/budget.md); empty: not used.
  std::string pyramid = "auto";
  // Splats are relocated and added every `step` iterations, after `first` and before `end`. If the range is
  // empty, this never happens.
  IndexRange refine = kAutoRange;
  BatchRates lr_batch{};    // whether learning rates are multiplied by the square root of `batch`
  double growth = kAuto;    // ratio of the numbers of splats after and before a refinement
  double growth_end = 1;    // share of the work after which no splats are added
  double copy_spread = kAuto;  // displacement of copies, relative to their size (method.md 4.3)
  double noise_lr = kAuto;     // factor of the position noise (method.md 4.3)

  // Loss
  double lambda_dssim = 0.2;
  double opacity_reg = kAuto;
  // Weight of the mean spatial scale. The published value 0.01 has no effect in the published code (method.md
  // 4.1).
  double scale_penalty = 0;
  Background background{.automatic = true};
  RandomBackground random_background{};  // random background colours (method.md 4.11)
  Appearance appearance{};               // how exposure and white balance are optimised (method.md 4.9)
  RefineCameras refine_cameras{};        // how cameras are optimised (method.md 4.10)

  // Learning rates
  double lr_cooldown = kAuto;                   // all rates decrease to 0 over this last share of the work
  double lr_xyz = kAuto, lr_xyz_final = kAuto;  // relative to the scene extent; exponential decay
  double lr_mean = kAuto, lr_beta = kAuto;
  double lr_l_triangle = kAuto;  // also for quaternions
  // The learning rate of harmonics other than the constant term is a twentieth of lr_rgb.
  double lr_rgb = kAuto, lr_opacity = kAuto, lr_scale = kAuto;

  // Rendering
  double eps2d = 0.3;
  double near_plane = kAuto, far_plane = kAuto;  // auto: see planes_of()
  std::string raster = "auto";                   // rasteriser: cpu, gpu or auto (by width of vectors)
  // Folder of a run whose refined cameras are used to render the views of its data. This member is not in the
  // table of fields.
  std::string run_cameras;
  // How training handles the size of the tile lists: it waits for the size, or it uses an upper bound and
  // checks the size later. `automatic` chooses by the type of the device. The results are the same. This
  // member is not in the table of fields, because it is only for tests and benchmarks.
  ListCounts list_counts{};
  // Keys that the user has set, even if their values are the defaults. This member is not in the table of
  // fields.
  std::set<std::string, std::less<>> chosen;
  bool query_grad = false;  // also compute the gradient through the view direction (method.md 3.3)

  // Skipped work (docs/variants.md)
  double alpha_min = 0;  // contributions with alpha <= alpha_min are skipped
  std::string freeze;    // parameter groups that are not trained, separated by commas
  MathMode math{};       // accuracy of powers in the kernels (docs/accuracy.md)

  // Data and output

  // Interval between evaluations on the test split: a number of iterations, or a number of seconds of
  // training followed by s. 0: evaluate only at the end.
  std::string eval_every = "0";
  int save_renders = 8;  // number of test views that are saved with their ground truth at the end; -1: all
  int log_every = 10;    // number of iterations between rows of log.csv

  // Saving and checking a run (docs/training.md)

  // Interval between checkpoints: a number of iterations, or a number of seconds of training followed by s.
  // 0: write a checkpoint only when training is interrupted.
  std::string checkpoint_every = "300s";
  OnNan on_nan{};  // what to do when a value is not finite; off: values are not checked
};

// Returns the fields of TrainSettings with key, help and allowed range.
std::span<const Field<TrainSettings>> train_fields();
// Returns the keys of all fields that have one of these uses (FieldUse).
std::vector<std::string_view> keys_used(unsigned uses);

// Splats are rendered if their depth is between these planes, which are in the unit of the data. Automatic
// planes are at 0.01 and 1e10 times settings.unit. If the unit is automatic too, they are at 0.01 and 1e10.
struct Planes {
  double near = 0, far = 0;
};
Planes planes_of(const TrainSettings& settings);

// Throws Error(usage) if the settings are invalid in a way that the ranges of the fields do not express.
void validate(const TrainSettings& settings);

// Returns whether the size, the rotation or the other entries of L are not trained (setting freeze).
bool freezes_shape(const TrainSettings& s);

// Returns the time that `budget` allows, in seconds, or 0 if there is no limit. Throws Error(usage) if the
// text is not a time.
double budget_seconds(const TrainSettings& settings);

struct RunInterval {
  int iterations = 0;  // 0: the interval is not in iterations
  double seconds = 0;  // 0: the interval is not in seconds
};
// These functions parse eval_every and checkpoint_every. They throw Error(usage) if the text is neither a
// number of iterations nor a number of seconds.
RunInterval evaluation_interval(const TrainSettings& settings);
RunInterval checkpoint_interval(const TrainSettings& settings);

struct SharePoint {
  int iteration = 0;
  double share = 0;  // share of the work that is done after this iteration
  // If this is not 0, the run changed its pace after this earlier iteration, before it reached this point.
  int left_at = 0;
};
// Returns the point up to which a run proceeds from `from` towards the next point `to` at a constant pace.
// This is `to`, or the point after the iteration to.left_at if the run changes its pace there.
SharePoint reached(const SharePoint& from, const SharePoint& to);
// Parses work_shares. Throws Error(usage) if the text is malformed, if a share exceeds 1, if iterations or
// shares do not increase, or if the last point does not match settings.iterations. Only after a share of 1, a
// smaller share may follow: the finished run was then continued.
std::vector<SharePoint> share_points(const TrainSettings& settings);
// Returns the points as a string for work_shares.
std::string to_string(const std::vector<SharePoint>& points);

struct PyramidStep {
  int factor = 1;
  double share = 0;  // share of the work at which the level ends
};
// Parses pyramid. Throws Error(usage) if the text is malformed, if the factors do not decrease, or if the
// shares do not increase.
std::vector<PyramidStep> pyramid_steps(const TrainSettings& settings);

}  // namespace ubs
