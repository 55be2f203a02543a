// SPDX-License-Identifier: Apache-2.0
// The classes of this file run stages that all back ends run in the same way, with the kernels of
// kernels/map. A class allocates its own buffers when they are first used.
//
// The template parameter `Kernels` stands for the kernels of a compiled program. It has these functions:
//   launch(kernel, elements, rows, arguments...)    launches a kernel with UBS_VW elements per work-item
//   launch_each(kernel, items, rows, arguments...)  launches a kernel with one element per work-item
//   lanes()                                         returns UBS_VW
// The template parameter `Sums` computes prefix sums. Its function exclusive(in, out, count) sets out[i] =
// in[0] + ... + in[i - 1] for i = 0 to count.
#pragma once

#include <utility>

#include "host/device/map_kernels.hpp"
#include "host/device/operation_checks.hpp"

namespace ubs {

// SkyStages runs DrawSky, SkyGradient and SkyStep. `map` contains the kernels of sky.cl. `step` contains the
// kernels of sky_step.cl, compiled with one lane.
template <typename Kernels>
class SkyStages {
 public:
  SkyStages(Device& device, Kernels map, Kernels step)
      : device_(device), map_(std::move(map)), step_(std::move(step)) {}

  void run(const DrawSky& a) {
    check_sky(a);
    const ImageShape& s = a.shape;
    map_.launch(kDrawSky, s.pitch(), s.rows(), a.cameras, a.camera, a.sky, s.pitch(), s.rows(),
                a.transmittance, a.image);
  }
  void run(const SkyGradient& a) {
    check_sky(a);
    const ImageShape& s = a.shape;
    const int strips = s.tiles_y(), rows = kSkyNumbers * strips;
    reserve(device_, sums_, "sky sums", static_cast<std::size_t>(rows) * static_cast<std::size_t>(s.pitch()));
    map_.launch(kSkyVjp, s.pitch(), strips, a.cameras, a.camera, s.width, s.height, s.pitch(), s.rows(),
                a.transmittance, a.v_image, sums_.view());
    map_.launch_each(kRowSums, rows, 1, sums_.view(), s.pitch(), rows);
    map_.launch_each(kSkyGradient, kSkyNumbers, 1, sums_.view(), s.pitch(), strips, a.gradient,
                     a.gradient_offset);
  }
  void run(const SkyStep& a) {
    check_sky(a);
    const BiasCorrection bias = bias_correction({.step = a.step});
    step_.launch_each(kSkyStep, kSkyNumbers, 1, a.state, a.gradient, a.views, a.rate, a.rate_harmonics,
                      AdamStep{}.beta1, AdamStep{}.beta2, a.epsilon, bias.inverse1, bias.inverse_sqrt2,
                      a.sentinel, a.stamp);
  }

 private:
  Device& device_;
  Kernels map_, step_;
  Buffer<float> sums_;
};

// AppearanceStages runs AppearanceStep, and the part of ImageLoss that maps the colours of a rendered image
// to those of its photograph. `map` contains the kernels of appearance.cl. `step` contains the kernels of
// appearance_step.cl, compiled with one lane.
template <typename Kernels>
class AppearanceStages {
 public:
  AppearanceStages(Device& device, Kernels map, Kernels step)
      : device_(device), map_(std::move(map)), step_(std::move(step)) {}

  // Calls `loss` with the image, mapped to the colours of the photograph. If a gradient is requested,
  // converts it to the gradient with respect to the image before the mapping.
  template <typename Loss>
  void with_colours(const ImageLoss& a, const Loss& loss) {
    if (a.appearance.size == 0) return loss(a);
    ImageLoss mapped = a;
    mapped.image = map(a);
    loss(mapped);
    if (a.v_image.size > 0) gradient(a);
  }
  void run(const AppearanceStep& a) {
    check_appearance(a);
    step_.launch_each(kAppearanceStep, kAppearanceNumbers, 1, a.state, a.images, a.image, a.gradient,
                      a.gradient_offset, a.rate_diagonal, a.rate_other, AdamStep{}.beta1, AdamStep{}.beta2,
                      AdamStep{}.epsilon, a.sentinel, a.stamp);
  }

 private:
  BufferView<float> map(const ImageLoss& a) {
    check_image_loss(a);
    const std::size_t plane = a.shape.plane();
    reserve(device_, mapped_, "mapped image", 3 * plane);
    map_.launch(kMapColours, plane, 1, a.image, static_cast<u32>(plane), a.appearance, a.appearance_offset,
                mapped_.view());
    return mapped_.view();
  }
  // Replaces v_image, the gradient with respect to the mapped image, by the gradient with respect to the
  // image, and computes the gradient with respect to the numbers of the appearance.
  void gradient(const ImageLoss& a) {
    const ImageShape& s = a.shape;
    const int strips = s.tiles_y(), rows = kAppearanceNumbers * strips;
    reserve(device_, sums_, "appearance sums",
            static_cast<std::size_t>(rows) * static_cast<std::size_t>(s.pitch()));
    map_.launch(kMapColoursVjp, s.pitch(), strips, a.image, s.width, s.height, s.pitch(), s.rows(),
                a.appearance, a.appearance_offset, a.v_image, sums_.view());
    map_.launch_each(kRowSums, rows, 1, sums_.view(), s.pitch(), rows);
    map_.launch_each(kAppearanceGradient, kAppearanceNumbers, 1, sums_.view(), s.pitch(), strips,
                     a.appearance, a.appearance_offset, a.v_appearance, a.v_appearance_offset);
  }

  Device& device_;
  Kernels map_, step_;
  Buffer<float> mapped_, sums_;
};

// ImageGradientStages runs AlphaToColours, DepthToRecords, DepthToImage and DepthFromRecords. `kernels`
// contains the kernels of image_gradient.cl, compiled with one lane.
template <typename Kernels>
class ImageGradientStages {
 public:
  ImageGradientStages(Device& device, Kernels kernels) : device_(device), kernels_(std::move(kernels)) {}

  void run(const AlphaToColours& a) {
    check_image_gradient(a);
    const ImageShape& s = a.shape;
    kernels_.launch_each(kAlphaToColours, s.plane(), 1, s.width, s.height, s.pitch(), s.rows(), a.v_alpha,
                         a.transmittance, a.image, a.v_image);
  }
  void run(const DepthToRecords& a) {
    check_image_gradient(a);
    const ImageShape& s = a.shape;
    const int strips = s.tiles_y();
    reserve(device_, sums_, "depth sums",
            2 * static_cast<std::size_t>(strips) * static_cast<std::size_t>(s.pitch()));
    kernels_.launch_each(kDepthSums, s.pitch(), strips, s.width, s.height, s.pitch(), s.rows(), a.depth,
                         a.v_depth, sums_.view());
    kernels_.launch_each(kRowSums, 2 * strips, 1, sums_.view(), s.pitch(), 2 * strips);
    kernels_.launch_each(kDepthMean, 1, 1, sums_.view(), s.pitch(), strips, a.mean);
    kernels_.launch_each(kDepthToRecords, a.count, 1, a.mean, a.count, a.records);
  }
  void run(const DepthToImage& a) {
    check_image_gradient(a);
    const ImageShape& s = a.shape;
    kernels_.launch_each(kDepthToImage, s.plane(), 1, s.width, s.height, s.pitch(), s.rows(), a.mean, a.depth,
                         a.v_depth, a.image, a.v_image);
  }
  void run(const DepthFromRecords& a) {
    check_image_gradient(a);
    kernels_.launch_each(kDepthFromRecords, a.count, 1, a.count, a.earlier, a.v_records);
  }

 private:
  Device& device_;
  Kernels kernels_;
  Buffer<float> sums_;
};

// DrawnStages runs PlaceDrawn, PickDrawn, UnpackDrawn and SpreadGradient with the kernels of drawn.cl.
template <typename Kernels, typename Sums>
class DrawnStages {
 public:
  DrawnStages(Device& device, Kernels kernels, Sums sums)
      : device_(device), kernels_(std::move(kernels)), sums_(std::move(sums)) {}

  std::uint32_t run(const PlaceDrawn& a) {
    kernels_.launch_each(kMarkDrawn, a.count + std::size_t{1}, 1, a.tile_counts, a.count, a.places);
    if (a.count == 0) return 0;
    sums_.exclusive(a.places, a.places, a.count);
    std::uint32_t drawn = 0;
    device_.read(*a.places.memory, a.count * sizeof(drawn), std::as_writable_bytes(std::span(&drawn, 1)));
    return drawn;
  }
  void run(const PickDrawn& a) {
    kernels_.launch_each(kPickDrawn, a.count, 1, a.records, a.tile_rects, a.places, a.count, a.drawn);
  }
  void run(const UnpackDrawn& a) {
    kernels_.launch_each(kUnpackDrawn, a.count, 1, a.records, a.count, a.depth_keys, a.tile_rects,
                         a.tile_counts);
  }
  void run(const SpreadGradient& a) {
    kernels_.launch_each(kSpreadGradient, a.count, 1, a.drawn, a.places, a.count, a.v_records);
  }

 private:
  Device& device_;
  Kernels kernels_;
  Sums sums_;
};

}  // namespace ubs
