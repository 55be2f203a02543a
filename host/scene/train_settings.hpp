// SPDX-License-Identifier: Apache-2.0
// TrainSettings holds all settings of a training run. The defaults are the published values (method.md 1.3,
// 4, 6), except for settings that are `auto`. Command line options, YAML keys, --set and the resolved
// configuration are all generated from the table of fields (train_fields).
#pragma once

#include <cstdint>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/background.hpp"
#include "host/base/index_range.hpp"
#include "host/scene/field.hpp"
#include "host/scene/math_mode.hpp"
#include "host/scene/model_variant.hpp"

namespace ubs {

// Number of iterations to which refine and other settings refer.
inline constexpr int kScheduleLength = 30000;

enum class Appearance { none, gain, affine };  // kernels/math/appearance.h
enum class RefineCameras { none, pose, pose_and_intrinsics };
enum class RandomBackground { automatic, off, on };
enum class ListCounts { automatic, wait, bound };
enum class PrincipalPoint { as_given, centre };
enum class BatchRates { none, sqrt };
enum class OnNan { stop, rollback, drop, off };

// Settings for reading data (docs/data.md). Each of these settings consists of a member here, a row with
// kOfReading in the table of fields, and its use in host/data.
struct ReadSettings {
  std::string layout = "auto";  // layout of the data folder (host/data/load_dataset.cpp); auto: by content
  std::string images = "auto";  // folder of images inside a COLMAP or LLFF folder; auto: images
  // Folder below sparse/ with the model; auto: the one with the most images.
  std::string colmap_model = "auto";
  std::string cache_folder;  // for undistorted images and video frames; empty: they are not stored
  int downscale = 1;         // images are reduced by this factor on load
  // COLMAP, LLFF, nerfstudio: every n-th view is a test view; 0: none; auto: host/data/split_views.hpp
  int test_every = kAutoInt;
  int image_cache_mb = 4096;         // memory for images; other images are decoded when needed
  PrincipalPoint principal_point{};  // centre: the centre of the image, as in the published code
  IndexRange frames;                 // frames of videos
  // Allow links, absolute paths and .. in the data to refer to files outside of the data folder.
  bool allow_outside = false;
  bool operator==(const ReadSettings&) const = default;
};

// The settings of a training run. The values of the enumerations are in the order of their words in the table
// of fields.
struct TrainSettings : ReadSettings {
  // Model
  int dim = 6;  // 3 | 4 (xyz + t) | 6 (+ view direction) | 7 (+ direction + t) ... 11 | kAutoInt
  // Number of random initial splats if the data contain no points; auto: by the size of the images.
  int init_points = kAutoInt;
  double init_extent = kAuto;    // random points are in [-init_extent, init_extent]^3; auto: by the cameras
  int cap_max = 300000;          // maximum number of splats; more initial points are thinned out
  int find_points = 75000;       // initial points that are looked for in the images
  double beta_dir_init = kAuto;  // raw direction betas; auto: 0, but -3 for N = 7
  double beta_query_init = 0;    // raw betas of time and further query values
  double unit = kAuto;           // length of the data that is 1 in training (host/scene/scene_unit.hpp)
  std::uint64_t seed = 42;

  // Variant of the method (docs/variants.md); recorded in the model file
  ModelVariant variant;
  bool conditioning_auto = true;  // variant.conditioning is chosen together with an automatic dim

  // Schedule. Iteration numbers refer to a run of 30 000 iterations and scale with `iterations`.
  int iterations = 30000;
  int batch = 1;  // views per step
  // Share of the work that is done after some iterations, such as 90:0.05,200:0.1; empty: proportional to the
  // iterations (host/train/work_share.hpp). 200:0.1@120 is a point that the run left after iteration 120.
  std::string work_shares;
  std::string pyramid;  // reduced images at the start, such as 4:0.2,2:0.5 (docs/budget.md); empty: none
  IndexRange refine{500, 25000, 100};  // after `first`, before `end`; empty range: never
  BatchRates lr_batch{};               // learning rates unchanged | times the square root of the batch
  double growth = 1.02;                // ratio of the numbers of splats after and before a refinement
  double growth_end = 1;               // share of the work after which no splats are added
  double noise_lr = kAuto;  // auto: 1 dynamic, 1.6e7 static, but 1e6 if unit is not auto (method.md 4.3)

  // Loss
  double lambda_dssim = 0.2;
  double opacity_reg = 0.01;
  double scale_penalty = 0;  // the published value 0.01 has no effect in the published code (method.md 4.1)
  Background background{.automatic = true};
  RandomBackground random_background{};  // method.md 4.11
  Appearance appearance{};               // learnt appearance of each training image (method.md 4.9)
  RefineCameras refine_cameras{};        // cameras of the training images (method.md 4.10)

  // Learning rates
  double lr_cooldown = 0;                         // final share of the work during which all rates fall to 0
  double lr_xyz = 1.6e-4, lr_xyz_final = 1.6e-6;  // times the scene extent, exponential decay
  double lr_mean = 1e-3, lr_beta = 1e-3;
  double lr_l_triangle = 1e-3;  // also for quaternions
  // auto: depends on colours and kernel (resolve_automatic). Harmonics beyond the constant term have a
  // twentieth of lr_rgb.
  double lr_rgb = kAuto, lr_opacity = kAuto, lr_scale = kAuto;

  // Rendering
  double eps2d = 0.3;
  double near_plane = kAuto, far_plane = kAuto;  // auto: planes_of()
  std::string raster = "auto";                   // rasteriser: auto (cpu on devices with vectors) | cpu | gpu
  // Folder of a run whose refined cameras are used to render the views of its data. This member is not in the
  // table of fields.
  std::string run_cameras;
  // How training handles the size of the tile lists: it waits for the size, or it uses an upper bound and
  // checks the size later; auto: by device type. The results are the same. This member is not in the table of
  // fields, because it is only for tests and benchmarks.
  ListCounts list_counts{};
  // Keys that the user has set, even to their default values. Automatic schedules do not change these
  // settings. This member is not in the table of fields.
  std::set<std::string, std::less<>> chosen;
  bool query_grad = false;  // gradient through the view direction (method.md 3.3)

  // Skipped work (docs/variants.md)
  double alpha_min = 0;  // contributions with alpha <= alpha_min are skipped
  std::string freeze;    // parameter groups that are not trained, separated by commas
  // Cheaper arithmetic (docs/accuracy.md)
  MathMode math{};  // arithmetic of powers

  // Data and output

  // Iterations between evaluations on the test split, or seconds of training with a trailing s; 0: only at
  // the end.
  std::string eval_every = "0";
  int save_renders = 8;  // number of test views that are saved with their ground truth at the end; -1: all
  int log_every = 10;    // iterations between rows of log.csv

  // Saving and checking a run (docs/training.md)

  // Iterations between checkpoints, or seconds of training with a trailing s; 0: only when interrupted.
  std::string checkpoint_every = "300s";
  OnNan on_nan{};  // reaction to a value that is not finite; off: no checks
};

// Returns the fields of TrainSettings with key, help and allowed range.
std::span<const Field<TrainSettings>> train_fields();
// Returns the keys of all fields that have one of these uses (FieldUse).
std::vector<std::string_view> keys_used(unsigned uses);

// Splats are rendered if their depth is between these planes, in the unit of the data. Automatic planes are
// 0.01 and 1e10 units of training, or units of the data if there is no training.
struct Planes {
  double near = 0, far = 0;
};
Planes planes_of(const TrainSettings& settings);

// Throws Error(usage) if the settings are invalid in a way that the ranges of the fields do not express.
void validate(const TrainSettings& settings);

struct RunInterval {
  int iterations = 0;  // 0: not by iterations
  double seconds = 0;  // 0: not by time
};
// These functions parse eval_every and checkpoint_every. They throw Error(usage) if the text is neither a
// number of iterations nor a number of seconds.
RunInterval evaluation_interval(const TrainSettings& settings);
RunInterval checkpoint_interval(const TrainSettings& settings);

struct SharePoint {
  int iteration = 0;
  double share = 0;  // share of the work that is done after this iteration
  // If it is not 0, the run changed its pace after this earlier iteration, on the way to this point.
  int left_at = 0;
};
// Returns where a run that is at `from` ends its way to the next point `to`: at this point, or where it
// leaves the way.
SharePoint reached(const SharePoint& from, const SharePoint& to);
// Parses work_shares. Iterations and shares must increase, and shares are at most 1. Throws Error(usage)
// otherwise.
std::vector<SharePoint> share_points(const TrainSettings& settings);
std::string to_string(const std::vector<SharePoint>& points);

struct PyramidStep {
  int factor = 1;
  double share = 0;  // share of the work at which the level ends
};
// Parses pyramid, which has decreasing factors at increasing shares. Throws Error(usage) otherwise.
std::vector<PyramidStep> pyramid_steps(const TrainSettings& settings);

}  // namespace ubs
