// SPDX-License-Identifier: Apache-2.0
// These functions check the arguments of stages. Every back end calls them before it launches a kernel. They
// check the conditions of stages.hpp that do not depend on the device. If a condition is violated, they throw
// Error(internal), because the pipeline has a defect.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <utility>

#include "host/base/error.hpp"
#include "host/device/stage_sizes.hpp"
#include "host/device/stages.hpp"
#include "kernels/layout.h"

namespace ubs {

// Throws an error if a stage of training is run although the stages were created without a backward pass.
inline void check_backward(const KernelConfig& config, const char* stage) {
  if (!config.backward)
    fail(ErrorKind::internal, "{}: these stages were created without a backward pass", stage);
}

inline void check_project_backward(const KernelConfig& config, const ProjectBackward& work) {
  check_backward(config, "projection backward");
  if (config.gaussian_arrays && work.accumulate)
    fail(ErrorKind::internal, "projection backward: accumulate is not supported with gaussian_arrays");
}

// Checks RasterForward and RasterBackward. `slots` says whether the masks and slots are needed.
template <typename Work>
void check_raster(const Work& work, bool slots) {
  const auto require = [](bool holds, const char* what) {
    if (!holds) fail(ErrorKind::internal, "raster: {}", what);
  };
  const std::size_t intersections = work.sorted_ids.size;
  require(work.shape.width > 0 && work.shape.height > 0, "the image has no pixels");
  require(work.tile_ranges.size > static_cast<std::size_t>(work.shape.tiles()), "tile_ranges is too short");
  require(!slots || (work.sorted_slots.size >= intersections && work.masks.size >= intersections),
          "sorted_slots or masks is shorter than sorted_ids");
  require(work.image.size >= 3 * work.shape.plane(), "the image buffer is too small for three planes");
}

// Checks the channels of RasterBackward.
inline void check_channels(const KernelConfig& config, const RasterBackward& work) {
  const std::size_t plane = work.shape.plane();
  if (work.v_image.size < 3 * plane)
    fail(ErrorKind::internal, "raster: v_image is too small for three planes");
  if (work.more_channels == 0) return;
  if (work.more_channels < 0 || !config.absgrad)
    fail(ErrorKind::internal, "raster: {} further channels without absgrad", work.more_channels);
  if (work.v_more.size < static_cast<std::size_t>(1 + work.more_channels) * plane)
    fail(ErrorKind::internal, "raster: v_more is too small for {} channels", work.more_channels);
}

// Checks the size of the list states of RasterForward and RasterBackward with RasterKind::gpu.
template <typename Work>
void check_list_states(const Work& work) {
  const std::uint64_t needed = stage_sizes::list_state_floats(work.sorted_ids.size);
  if (work.states.size < needed)
    fail(ErrorKind::internal, "raster: the buffer of the list states has {} floats, but {} are needed",
         work.states.size, needed);
}
// Returns the number of work-groups that the backward rasteriser launches. There is one for each segment of a
// list.
inline std::uint64_t list_segments(const RasterBackward& work) {
  return stage_sizes::list_segments(static_cast<std::uint64_t>(work.shape.tiles()), work.sorted_ids.size);
}

inline void check_weights(const MeasureWeights& work) {
  const auto require = [](bool holds, const char* what) {
    if (!holds) fail(ErrorKind::internal, "weights: {}", what);
  };
  const std::size_t intersections = work.sorted_ids.size;
  require(work.masks.size >= intersections && work.sorted_slots.size >= intersections,
          "the lists have different lengths");
  require(work.weights.size >= intersections, "the weights are shorter than the lists");
}

// Checks the sizes of a SplatView. `rows` is the number of parameters per splat.
inline void check_view(const SplatView& splats, std::size_t rows) {
  if (splats.count > splats.stride || splats.stride % 64 != 0 || splats.params.size < rows * splats.stride)
    fail(ErrorKind::internal, "{} splats with stride {} and {} rows do not fit into a buffer with {} values",
         splats.count, splats.stride, rows, splats.params.size);
}

inline void check_camera_backward(const KernelConfig& config, const CameraBackward& work) {
  check_backward(config, "camera backward");
  if (config.frozen != 0)
    fail(ErrorKind::internal, "camera backward: the stages do not compute the gradients of frozen groups");
  if (work.lanes == 0 || work.lanes % 64 != 0 ||
      work.v_camera.size < static_cast<std::size_t>(kCameraGrads) * work.lanes)
    fail(ErrorKind::internal, "camera backward: {} lanes do not fit into {} values", work.lanes,
         work.v_camera.size);
}

// Checks AdamStep. `rows` is the number of parameters per splat, and `learnt` is the number of those that are
// trained.
inline void check_adam(const AdamStep& step, std::size_t rows, std::size_t learnt) {
  check_view(step.splats, rows);
  if (step.learning_rates.size < rows)
    fail(ErrorKind::internal, "Adam: the number of learning rates is {}, but there are {} parameter rows",
         step.learning_rates.size, rows);
  const std::size_t values = learnt * step.splats.stride;
  if (step.v_params.size < values || step.moment1.size < values || step.moment2.size < values)
    fail(ErrorKind::internal,
         "Adam: gradients and moments have {}, {} and {} values, which is too few for {} rows of {}",
         step.v_params.size, step.moment1.size, step.moment2.size, learnt, step.splats.stride);
  if (step.step == 0) fail(ErrorKind::internal, "Adam: the step is 0, but steps are counted from 1");
  if (step.sentinel.size > 0 && step.stamp == 0)
    fail(ErrorKind::internal, "Adam: the stamp must not be 0 if a sentinel is passed");
}

// BiasCorrection contains the factors of the bias correction that Adam kernels multiply with (AdamConstants
// in kernels/math/adam.h).
struct BiasCorrection {
  float inverse1, inverse_sqrt2;
};
inline BiasCorrection bias_correction(const AdamStep& a) {
  const double step = static_cast<double>(a.step);
  const double bias1 = 1 - std::pow(static_cast<double>(a.beta1), step);
  const double bias2 = 1 - std::pow(static_cast<double>(a.beta2), step);
  return {static_cast<float>(1 / bias1), static_cast<float>(1 / std::sqrt(bias2))};
}

// Returns the weights of the penalties of one splat.
inline PenaltyWeights weights_per_splat(const Regularise& a) {
  return per_splat(a.weights, static_cast<float>(a.total > 0 ? a.total : a.splats.count));
}

// Returns the number of pixels that the sums are divided by to get means. If the mask is 0 for all pixels,
// returns 1, because the sums are 0.
inline float counted_pixels(const ImageLoss& loss) {
  if (loss.mask.size > 0) return static_cast<float>(std::max(1u, loss.counted));
  return static_cast<float>(loss.shape.width) * static_cast<float>(loss.shape.height);
}

// Returns the weights with which one value of the image contributes to the gradient of the loss.
inline LossWeights weights_per_value(const ImageLoss& loss) {
  return per_value(loss.weights, loss.scale, 3.0f * counted_pixels(loss));
}

inline void check_image_loss(const ImageLoss& loss) {
  const ImageShape& shape = loss.shape;
  if (shape.width < 1 || shape.height < 1)
    fail(ErrorKind::internal, "image loss: the image has {} x {} pixels", shape.width, shape.height);
  const std::size_t values =
      3 * static_cast<std::size_t>(shape.width) * static_cast<std::size_t>(shape.height);
  const std::size_t target = loss.target.size > 0 ? loss.target.size : loss.target_float.size;
  if (target < values)
    fail(ErrorKind::internal, "image loss: the target has {} values, but the image has {}", target, values);
  if (loss.mask.size > 0 && (loss.mask.size < values / 3 || loss.counted > values / 3))
    fail(ErrorKind::internal,
         "image loss: a mask of {} values, of which {} are set, does not match an image of {} pixels",
         loss.mask.size, loss.counted, values / 3);
  if (loss.image.size < 3 * shape.plane() || (loss.v_image.size > 0 && loss.v_image.size < 3 * shape.plane()))
    fail(ErrorKind::internal,
         "image loss: the buffer of the image or of the image gradient is too small for three planes");
  if (loss.sums.size < loss.sums_offset + 8ull)
    fail(ErrorKind::internal, "image loss: 8 sums at index {} do not fit into {} values", loss.sums_offset,
         loss.sums.size);
  if (loss.clamp && loss.v_image.size > 0)
    fail(ErrorKind::internal, "image loss: clamping is only supported for evaluation, without a gradient");
  const auto has_room = [](const BufferView<float>& numbers, std::uint32_t offset) {
    return numbers.size >= offset + std::size_t{kAppearanceNumbers};
  };
  if (loss.appearance.size > 0 &&
      (!has_room(loss.appearance, loss.appearance_offset) ||
       (loss.v_image.size > 0 && !has_room(loss.v_appearance, loss.v_appearance_offset))))
    fail(ErrorKind::internal,
         "image loss: the buffer of the appearance, or of its gradient, has fewer than 12 numbers");
}

inline void check_sky(const DrawSky& a) {
  if (a.sky.size < kSkyNumbers || a.image.size < 3 * a.shape.plane() ||
      a.transmittance.size < a.shape.plane() || a.cameras.size < (a.camera + std::size_t{1}) * kCameraStride)
    fail(ErrorKind::internal,
         "sky: one of the buffers is too small: {} coefficients, {} values of the image and {} values of the "
         "transmittance for {}x{} pixels",
         a.sky.size, a.image.size, a.transmittance.size, a.shape.width, a.shape.height);
}

inline void check_sky(const SkyGradient& a) {
  if (a.gradient.size < a.gradient_offset + std::size_t{kSkyNumbers} ||
      a.v_image.size < 3 * a.shape.plane() || a.transmittance.size < a.shape.plane() ||
      a.cameras.size < (a.camera + std::size_t{1}) * kCameraStride)
    fail(ErrorKind::internal,
         "sky: the buffer of the gradient is too small, or that of the image is too small for {}x{} pixels",
         a.shape.width, a.shape.height);
}

inline void check_sky(const SkyStep& a) {
  const std::size_t gradients = std::size_t{a.views} * kSkyNumbers;
  if (a.state.size < kSkyState || a.gradient.size < gradients || a.step == 0)
    fail(ErrorKind::internal,
         "sky: invalid step: number {} (at least 1), {} values of the state (at least {}), {} values of the "
         "gradients (at least {})",
         a.step, a.state.size, kSkyState, a.gradient.size, gradients);
  if (a.sentinel.size > 0 && a.stamp == 0)
    fail(ErrorKind::internal, "sky: the stamp must not be 0 if a sentinel is passed");
}

// `sizes` contains buffers with the numbers of floats that they must have at least.
inline void check_image_gradient(
    std::initializer_list<std::pair<const BufferView<float>*, std::size_t>> sizes) {
  for (const auto& [view, needed] : sizes)
    if (view->size < needed)
      fail(ErrorKind::internal, "image gradient: a buffer has {} values, but {} are needed", view->size,
           needed);
}
inline void check_image_gradient(const AlphaToColours& a) {
  const std::size_t plane = a.shape.plane();
  check_image_gradient(
      {{&a.v_alpha, plane}, {&a.transmittance, plane}, {&a.image, 3 * plane}, {&a.v_image, 3 * plane}});
}
inline void check_image_gradient(const DepthToRecords& a) {
  const std::size_t plane = a.shape.plane(), records = std::size_t{a.count} * kSplatStride;
  check_image_gradient({{&a.depth, plane}, {&a.v_depth, plane}, {&a.mean, 1}, {&a.records, records}});
}
inline void check_image_gradient(const DepthToImage& a) {
  const std::size_t plane = a.shape.plane();
  check_image_gradient(
      {{&a.depth, plane}, {&a.v_depth, plane}, {&a.mean, 1}, {&a.image, 3 * plane}, {&a.v_image, 3 * plane}});
}
inline void check_image_gradient(const DepthFromRecords& a) {
  const std::size_t records = std::size_t{a.count} * kGradStride;
  check_image_gradient({{&a.v_records, records}, {&a.earlier, a.earlier.size > 0 ? records : 0}});
}

inline void check_appearance(const AppearanceStep& step) {
  const std::size_t state = std::size_t{step.images} * kAppearanceState;
  const std::size_t gradient = step.gradient_offset + std::size_t{kAppearanceNumbers};
  if (step.image >= step.images || step.state.size < state || step.gradient.size < gradient)
    fail(ErrorKind::internal,
         "appearance: invalid step: image {} (less than {}), {} values of the state (at least {}), {} values "
         "of the gradients (at least {})",
         step.image, step.images, step.state.size, state, step.gradient.size, gradient);
}

}  // namespace ubs
