// SPDX-License-Identifier: Apache-2.0
// What every back end checks of an operation of metric_ops.hpp before it launches anything: sizes against
// buffers, and that offsets fit the kernels' 32-bit numbers. A violation is a mistake of the caller, hence
// Error(internal).
#pragma once

#include <limits>

#include "host/base/error.hpp"
#include "host/device/metric_ops.hpp"

namespace ubs {

inline void require_metric(bool holds, const char* what) {
  if (!holds) fail(ErrorKind::internal, "image metrics: {}", what);
}
inline bool fits_int(std::size_t value) {
  return value <= static_cast<std::size_t>(std::numeric_limits<int>::max());
}
inline bool holds_planes(const BufferView<float>& view, const PlanarSize& size, int channels) {
  return size.width > 0 && size.height > 0 && channels > 0 && fits_int(size.plane()) &&
         view.size >= size.floats(static_cast<std::size_t>(channels));
}

inline void check_operation(const LoadImage& a) {
  const DeviceImage& image = a.image;
  require_metric(holds_planes(a.out, image.size, 3), "load_image: output too small");
  if (image.bytes.memory) {
    require_metric(image.bytes.size >= 3 * image.size.pixels(), "load_image: image too small");
  } else {
    require_metric(image.pitch >= image.size.width && image.rows >= image.size.height &&
                       image.values.size >= 3ull * image.pitch * image.rows,
                   "load_image: image too small");
  }
}
inline void check_operation(const Im2col& a) {
  require_metric(holds_planes(a.image, a.size, a.channels), "im2col: image too small");
  require_metric(a.count > 0 && a.pitch % 16 == 0 && a.pitch >= a.count && a.out_width > 0,
                 "im2col: bad columns");
  require_metric(a.matrix.size >= static_cast<std::size_t>(a.channels) * a.window * a.window * a.pitch,
                 "im2col: matrix too small");
}
inline void check_operation(const MatrixProduct& a) {
  const auto last = [](std::size_t offset, int rows, int pitch, int columns) {
    return offset + static_cast<std::size_t>(rows - 1) * pitch + columns;
  };
  require_metric(a.rows > 0 && a.columns > 0 && a.inner > 0, "matrix product: empty");
  require_metric(a.b_pitch >= a.columns && a.c_pitch >= a.columns, "matrix product: rows overlap");
  require_metric(a.a.size >= static_cast<std::size_t>(a.rows) * a.inner,
                 "matrix product: first factor too small");
  require_metric(a.b.size >= last(a.b_offset, a.inner, a.b_pitch, a.columns),
                 "matrix product: second factor too small");
  require_metric(a.c.size >= last(a.c_offset, a.rows, a.c_pitch, a.columns),
                 "matrix product: result too small");
}
inline void check_operation(const BiasRelu& a) {
  require_metric(a.first % 16 == 0 && fits_int(a.first) &&
                     a.bias.size >= static_cast<std::size_t>(a.channels) &&
                     a.features.size >= a.first + a.size.floats(static_cast<std::size_t>(a.channels)),
                 "bias_relu: features or bias too small");
}
inline void check_operation(const MaxPool& a) {
  require_metric(holds_planes(a.image, a.size, a.channels) && holds_planes(a.out, a.out_size, a.channels),
                 "max_pool: image or output too small");
  require_metric(
      (a.out_size.width - 1) * a.stride < a.size.width && (a.out_size.height - 1) * a.stride < a.size.height,
      "max_pool: windows outside of the image");
}
inline void check_operation(const LpipsDistance& a) {
  require_metric(holds_planes(a.a, a.size, a.channels) && holds_planes(a.b, a.size, a.channels),
                 "lpips_distance: features too small");
  require_metric(a.weights.size >= static_cast<std::size_t>(a.channels) && a.scratch.size >= a.size.plane(),
                 "lpips_distance: weights or scratch too small");
  require_metric(a.sums.size >= static_cast<std::size_t>(a.sums_offset + kPartialSums),
                 "lpips_distance: no room for sums");
}
inline void check_operation(const ValidSsim& a) {
  require_metric(a.size.width >= kSsimWindow && a.size.height >= kSsimWindow,
                 "valid_ssim: image smaller than a window");
  require_metric(holds_planes(a.a, a.size, a.channel + 1) && holds_planes(a.b, a.size, a.channel + 1),
                 "valid_ssim: images too small");
  require_metric(a.scratch.size >= valid_ssim_scratch(a.size) && fits_int(valid_ssim_scratch(a.size)),
                 "valid_ssim: scratch too small");
  require_metric(a.sums.size >= static_cast<std::size_t>(a.sums_offset + kPartialSums),
                 "valid_ssim: no room for sums");
}

}  // namespace ubs
