// SPDX-License-Identifier: Apache-2.0
// Every choice of a training run, with the published defaults (method.md 1.3, 4, 6) but for what is `auto`.
// The table of fields (train_fields) is the one place from which options, YAML keys, --set and the resolved
// configuration are made.
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

inline constexpr int kScheduleLength = 30000;  // iterations to which refine and others refer

enum class Appearance { none, gain, affine };  // kernels/math/appearance.h
enum class RefineCameras { none, pose, pose_and_intrinsics };
enum class RandomBackground { automatic, off, on };
enum class ListCounts { automatic, wait, bound };
enum class PrincipalPoint { as_given, centre };
enum class BatchRates { none, sqrt };
enum class OnNan { stop, rollback, drop, off };

// How data are read (docs/data.md). A setting that changes this is a member here, a row of the table of
// fields with kOfReading, and its use in host/data.
struct ReadSettings {
  std::string layout = "auto";        // of the data folder (host/data/load_dataset.cpp); auto: by content
  std::string images = "auto";        // folder of images inside a COLMAP or LLFF folder; auto: images
  std::string colmap_model = "auto";  // folder below sparse/ with the model; auto: the one of most images
  std::string cache_folder;           // for undistorted images and video frames; empty: none kept
  int downscale = 1;                  // images are reduced by this factor on load
  int test_every = 8;                 // COLMAP, LLFF, nerfstudio: every n-th view is a test view; 0: none
  int image_cache_mb = 4096;          // images beyond it are decoded when needed
  PrincipalPoint principal_point{};   // centre (of the image): as the published code has it
  IndexRange frames;                  // of videos
  bool allow_outside = false;  // read what the data name outside of their folder: links, absolute paths, ..
  bool operator==(const ReadSettings&) const = default;
};

// Choices in the order of their words in the table.
struct TrainSettings : ReadSettings {
  // Model
  int dim = 6;  // 3 | 4 (xyz + t) | 6 (+ view direction) | 7 (+ direction + t) ... 11 | kAutoInt
  int init_points =
      kAutoInt;  // random initial splats when the data bring no points; auto: by the pictures' size
  double init_extent = kAuto;    // random points lie in [-init_extent, init_extent]^3; auto: by the cameras
  int cap_max = 300000;          // most splats; initial points beyond it are thinned out
  double beta_dir_init = kAuto;  // raw direction betas; auto: 0, but -3 for N = 7
  double beta_query_init = 0;    // raw betas of time and further query values
  double unit = kAuto;           // length of the data that is 1 in training (host/scene/scene_unit.hpp)
  std::uint64_t seed = 42;

  // Form of the method (docs/variants.md); recorded in the model file
  ModelVariant variant;
  bool conditioning_auto = true;  // variant.conditioning is to be chosen with an automatic dim

  // Schedule. Iteration numbers are those of a run of 30 000 iterations and scale with `iterations`.
  int iterations = 30000;
  int batch = 1;            // views per step
  std::string work_shares;  // share of the work that is done after some iterations, such as 90:0.05,200:0.1;
                            // empty: in proportion to the iterations (host/train/work_share.hpp)
  std::string pyramid;  // training on reduced images first, such as 4:0.2,2:0.5 (docs/budget.md); empty: not
  IndexRange refine{500, 25000, 100};  // after the first, before the end; an empty one: never
  BatchRates lr_batch{};               // learning rates as given | times the square root of the batch
  double growth = 1.02;                // splats after / before a refinement
  double growth_end = 1;               // share of the work from which on no splats are added
  double noise_lr = kAuto;             // auto: 1e6 static, 1 dynamic (method.md 4.3)

  // Loss
  double lambda_dssim = 0.2;
  double opacity_reg = 0.01;
  double scale_penalty = 0;  // the published 0.01 has no effect there (method.md 4.1)
  Background background{.automatic = true};
  RandomBackground random_background{};  // method.md 4.11
  Appearance appearance{};               // of each training image, learnt (method.md 4.9)
  RefineCameras refine_cameras{};        // of the training images (method.md 4.10)

  // Learning rates
  double lr_cooldown = 0;  // share of the work at its end over which all of them fall to 0
  double lr_xyz = 1.6e-4, lr_xyz_final = 1.6e-6;  // times the scene extent, exponential decay
  double lr_mean = 1e-3, lr_beta = 1e-3;
  double lr_l_triangle = 1e-3;  // quaternions too
  // auto: by the form of colours and kernel (resolve_automatic). Harmonics beyond the constant term have a
  // twentieth of lr_rgb.
  double lr_rgb = kAuto, lr_opacity = kAuto, lr_scale = kAuto;

  // Rendering
  double eps2d = 0.3;
  double near_plane = kAuto, far_plane = kAuto;  // auto: planes_of()
  std::string raster = "auto";                   // rasteriser: auto (cpu on vectors) | cpu | gpu
  // Folder of cameras that a run has refined, which views of its data are drawn from: not in the table of
  // fields.
  std::string run_cameras;
  // Size of the tile lists: wait for it | bound, checked late; auto: by device type. The results are the
  // same: likewise not in the table, for tests and benchmarks alone.
  ListCounts list_counts{};
  // Keys that somebody has set, to whatever value: schedules that are chosen leave them alone. Likewise not
  // in the table.
  std::set<std::string, std::less<>> chosen;
  bool query_grad = false;  // gradient through the view direction (method.md 3.3)

  // Work left out (docs/variants.md)
  double alpha_min = 0;  // contributions of alpha <= alpha_min are left out
  std::string freeze;    // comma-separated parameter groups that are not learnt
  // Cheaper arithmetic (docs/accuracy.md)
  MathMode math{};  // of powers

  // Data and output
  std::string eval_every = "0";  // iterations, or seconds of training with an s, between evaluations on the
                                 // test split; 0: only at the end
  int save_renders = 8;          // test views written beside their ground truth at the end; -1: all
  int log_every = 10;            // iterations between rows of log.csv

  // Keeping and watching a run (docs/training.md)
  std::string checkpoint_every =
      "300s";      // iterations, or seconds of training with an s; 0: only when interrupted
  OnNan on_nan{};  // what to do when a value is not finite; off: do not look
};

// The fields of TrainSettings with key, help, and allowed range.
std::span<const Field<TrainSettings>> train_fields();
// Keys of the fields that have one of these uses (FieldUse).
std::vector<std::string_view> keys_used(unsigned uses);

// Splats are drawn whose depth is between these, in the unit of the data. Automatic ones are 0.01 and 1e10
// units of training; where there is no training, of the data.
struct Planes {
  double near = 0, far = 0;
};
Planes planes_of(const TrainSettings& settings);

// Throws Error(usage) for combinations that the fields' ranges cannot express.
void validate(const TrainSettings& settings);

struct RunInterval {
  int iterations = 0;  // 0: not by iterations
  double seconds = 0;  // 0: not by time
};
// eval_every and checkpoint_every; throw Error(usage) for what is neither iterations nor seconds.
RunInterval evaluation_interval(const TrainSettings& settings);
RunInterval checkpoint_interval(const TrainSettings& settings);

struct SharePoint {
  int iteration = 0;
  double share = 0;  // of the work that is done after it
};
// work_shares: both rise, and shares are at most 1; throws Error(usage) when it is anything else.
std::vector<SharePoint> share_points(const TrainSettings& settings);
std::string to_string(const std::vector<SharePoint>& points);

struct PyramidStep {
  int factor = 1;
  double share = 0;  // of the work, where the level ends
};
// pyramid: falling factors at rising shares; throws Error(usage) when it is anything else.
std::vector<PyramidStep> pyramid_steps(const TrainSettings& settings);

}  // namespace ubs
