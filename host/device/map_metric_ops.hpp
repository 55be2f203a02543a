// SPDX-License-Identifier: Apache-2.0
// MapMetricOps runs the operations of image metrics that all back ends run in the same way, with the kernels
// of network.cl and ssim_valid.cl in kernels/map. map_stages.hpp explains the template parameter `Kernels`.
#pragma once

#include <utility>

#include "host/device/map_kernels.hpp"
#include "host/device/metric_ops.hpp"

namespace ubs {

template <typename Kernels>
class MapMetricOps : public MetricOps {
 public:
  MapMetricOps(Kernels network, Kernels ssim) : network_(std::move(network)), ssim_(std::move(ssim)) {}

  void load_image(const LoadImage& a) override {
    const PlanarSize& size = a.image.size;
    network_.launch_each(kLoadImage, size.plane(), 3, a.image.bytes, a.image.values, size.width, size.height,
                         a.image.pitch, a.image.rows, a.scale[0], a.scale[1], a.scale[2], a.offset[0],
                         a.offset[1], a.offset[2], plane(size), a.out);
  }
  void im2col(const Im2col& a) override {
    network_.launch(kIm2col, a.count, a.channels * a.window * a.window, a.image, a.size.width, a.size.height,
                    plane(a.size), a.window, a.stride, a.padding, a.out_width, a.first, a.count, a.pitch,
                    a.matrix);
  }
  void bias_relu(const BiasRelu& a) override {
    network_.launch(kBiasRelu, a.size.plane(), a.channels, a.features, static_cast<int>(a.first), a.bias,
                    plane(a.size));
  }
  void max_pool(const MaxPool& a) override {
    network_.launch_each(kMaxPool, a.out_size.pixels(), a.channels, a.image, a.size.width, a.size.height,
                         plane(a.size), a.window, a.stride, a.out_size.width, a.out_size.height,
                         plane(a.out_size), a.out);
  }
  void lpips_distance(const LpipsDistance& a) override {
    network_.launch(kLpipsDistance, a.size.plane(), 1, a.a, a.b, a.weights, a.channels,
                    static_cast<int>(a.size.pixels()), plane(a.size), a.scratch);
    sum(a.scratch, 0, a.size.plane(), a.sums, a.sums_offset);
  }
  void valid_ssim(const ValidSsim& a) override {
    const PlanarSize windows = valid_windows(a.size);
    const std::size_t pitch = valid_ssim_pitch(a.size),
                      maps = 4 * pitch * static_cast<std::size_t>(a.size.height);
    ssim_.launch(kSsimRows, windows.width, a.size.height, a.a, a.b,
                 static_cast<int>(static_cast<std::size_t>(a.channel) * a.size.plane()), a.size.width,
                 a.size.height, static_cast<int>(pitch), a.scratch);
    ssim_.launch(kSsimColumns, pitch, windows.height, a.scratch, a.size.width, a.size.height,
                 static_cast<int>(pitch), static_cast<int>(maps));
    sum(a.scratch, maps, pitch * static_cast<std::size_t>(windows.height), a.sums, a.sums_offset);
  }

 private:
  static int plane(const PlanarSize& size) { return static_cast<int>(size.plane()); }
  void sum(BufferView<float> values, std::size_t first, std::size_t count, BufferView<float> sums,
           int offset) {
    const int groups = kPartialSums / static_cast<int>(network_.lanes());
    network_.launch_each(kSumInParts, groups, 1, values, static_cast<int>(first), static_cast<int>(count),
                         groups, offset, sums);
  }

  Kernels network_, ssim_;
};

}  // namespace ubs
