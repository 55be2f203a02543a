// SPDX-License-Identifier: Apache-2.0
// MetricOps is the interface between image metrics and a back end, in addition to Stages. Its operations are
// the layers of a convolutional network, the distance between two images that is computed from their features
// (LPIPS), and the SSIM over the windows that are inside the image. Each operation enqueues its work and
// returns at once.
//
// Images and features consist of planes, one per channel, whose rows are stored one after the other without
// padding. Channel c starts at index c * padded_plane(width * height). Buffers have kPlanePadding unused
// elements after the last plane, because kernels read vectors of pixels, which may extend beyond the end of a
// plane.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "host/device/device.hpp"

namespace ubs {

constexpr std::size_t kPlanePadding = 32;
constexpr int kPartialSums = 256;  // partial sums per result; the host adds them in double precision

inline std::size_t padded_plane(std::size_t pixels) { return (pixels + 15) / 16 * 16; }

struct PlanarSize {
  int width = 0, height = 0;
  std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  std::size_t plane() const { return padded_plane(pixels()); }
  std::size_t floats(std::size_t channels) const { return channels * plane() + kPlanePadding; }
};

// DeviceImage is an RGB image on the device. It is stored either as 8-bit values (3, height, width) in
// `bytes`, or as floats (3, rows, pitch) in `values`, with planes that are padded as in ImageShape.
struct DeviceImage {
  PlanarSize size;
  BufferView<std::uint8_t> bytes;
  BufferView<float> values;
  int pitch = 0, rows = 0;
};

// Loads an image as input of a network. Its values v are clamped to [0, 1] and converted to v * scale +
// offset, with a scale and an offset per channel.
struct LoadImage {
  DeviceImage image;
  std::array<float, 3> scale{1, 1, 1}, offset{0, 0, 0};
  BufferView<float> out;
};

// Prepares a convolution, which is then computed as a matrix product. Writes the windows of `count` output
// pixels, starting with the pixel `first`, as columns of a matrix.
struct Im2col {
  BufferView<float> image;
  PlanarSize size;
  int channels = 0, window = 1, stride = 1, padding = 0;
  int out_width = 0;
  int first = 0, count = 0;
  int pitch = 0;             // elements per row of the matrix: count, rounded up to a multiple of 16
  BufferView<float> matrix;  // out (channels * window * window, pitch)
};

// Computes C = A B for row-major matrices A (rows, inner), B (inner, columns) and C (rows, columns).
struct MatrixProduct {
  int rows = 0, columns = 0, inner = 0;
  BufferView<float> a;  // its rows have `inner` elements, without padding
  BufferView<float> b;  // starts at b_offset, and its rows start b_pitch elements apart
  std::size_t b_offset = 0;
  int b_pitch = 0;
  BufferView<float> c;  // out; starts at c_offset, and its rows start c_pitch elements apart
  std::size_t c_offset = 0;
  int c_pitch = 0;
};

// Computes features = max(features + bias, 0).
struct BiasRelu {
  BufferView<float> features, bias;
  PlanarSize size;
  std::size_t first = 0;  // element where the first channel starts
  int channels = 0;
};

// Computes the maximum of each window. Windows are clipped at the right and at the lower edge of the image.
struct MaxPool {
  BufferView<float> image;
  PlanarSize size, out_size;
  int channels = 0, window = 1, stride = 1;
  BufferView<float> out;
};

// Computes the distance between the features a and b (kernels/math/lpips.h), summed over the pixels.
struct LpipsDistance {
  BufferView<float> a, b, weights;
  PlanarSize size;
  int channels = 0;
  BufferView<float> scratch;  // size.plane()
  BufferView<float> sums;     // out: kPartialSums partial sums, from index sums_offset on
  int sums_offset = 0;
};

// Computes 1 - SSIM of one channel, summed over the windows that are inside the image.
struct ValidSsim {
  BufferView<float> a, b;
  PlanarSize size;  // at least 11 x 11
  int channel = 0;
  BufferView<float> scratch;  // valid_ssim_scratch(size)
  BufferView<float> sums;     // out: kPartialSums partial sums, from index sums_offset on
  int sums_offset = 0;
};
// valid_windows() returns the number of windows per row and per column. valid_ssim_scratch() returns the
// number of floats of the scratch memory of ValidSsim, which consists of four planes of sums and one plane of
// results.
constexpr int kSsimWindow = 11;
inline PlanarSize valid_windows(PlanarSize size) {
  return {size.width - kSsimWindow + 1, size.height - kSsimWindow + 1};
}
inline std::size_t valid_ssim_pitch(PlanarSize size) {
  return padded_plane(static_cast<std::size_t>(valid_windows(size).width));
}
inline std::size_t valid_ssim_scratch(PlanarSize size) {
  return valid_ssim_pitch(size) * static_cast<std::size_t>(4 * size.height + valid_windows(size).height);
}

class MetricOps {
 public:
  virtual ~MetricOps() = default;
  virtual void load_image(const LoadImage&) = 0;
  virtual void im2col(const Im2col&) = 0;
  virtual void matrix_product(const MatrixProduct&) = 0;
  virtual void bias_relu(const BiasRelu&) = 0;
  virtual void max_pool(const MaxPool&) = 0;
  virtual void lpips_distance(const LpipsDistance&) = 0;
  virtual void valid_ssim(const ValidSsim&) = 0;
  // Returns the size [bytes] of the matrix of im2col for which matrix products are fastest. On CPUs this
  // matrix fits into the cache of a core.
  virtual std::size_t matrix_bytes() const = 0;
  // Returns the device memory [bytes] that matrix_product allocates and keeps. The views of the argument may
  // be empty.
  virtual std::size_t product_bytes(const MatrixProduct&) const = 0;
};

// Returns the MetricOps of a device. PSNR, and SSIM with windows that extend beyond the image, belong to
// ImageLoss in stages.hpp instead.
std::unique_ptr<MetricOps> make_metric_ops(Device& device);

}  // namespace ubs
