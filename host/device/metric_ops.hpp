// SPDX-License-Identifier: Apache-2.0
// MetricOps is the interface between image metrics and a back end, in addition to Stages. Its operations are
// the layers of a convolutional network, the distance of two images that is computed from their features
// (LPIPS), and the SSIM of windows. Each operation is one virtual call, which enqueues the work and returns
// at once. Images and features are planar, with consecutive rows: channel c starts at c * plane, where plane
// is padded_plane(width * height). Buffers have kPlanePadding spare elements after the last plane, because
// vectors of pixels are read across the ends of rows.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "host/device/device.hpp"

namespace ubs {

constexpr std::size_t kPlanePadding = 32;
constexpr int kPartialSums = 256;  // number of partial sums per result; the host adds them in double

inline std::size_t padded_plane(std::size_t pixels) { return (pixels + 15) / 16 * 16; }

struct PlanarSize {
  int width = 0, height = 0;
  std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  std::size_t plane() const { return padded_plane(pixels()); }
  std::size_t floats(std::size_t channels) const { return channels * plane() + kPlanePadding; }
};

// An RGB image on the device, either as 8 bit (3, height, width), or as float (3, rows, pitch) with planes
// padded as in ImageShape.
struct DeviceImage {
  PlanarSize size;
  BufferView<std::uint8_t> bytes;
  BufferView<float> values;
  int pitch = 0, rows = 0;
};

struct LoadImage {  // clamped to [0, 1], then value * scale + offset by channel
  DeviceImage image;
  std::array<float, 3> scale{1, 1, 1}, offset{0, 0, 0};
  BufferView<float> out;
};

struct Im2col {  // writes output pixels first .. first + count - 1 as columns of a matrix
  BufferView<float> image;
  PlanarSize size;
  int channels = 0, window = 1, stride = 1, padding = 0;
  int out_width = 0;
  int first = 0, count = 0;
  int pitch = 0;             // of a row of the matrix: count rounded up to a multiple of 16
  BufferView<float> matrix;  // out (channels * window * window, pitch)
};

struct MatrixProduct {  // C (rows, columns) = A (rows, inner) B (inner, columns), all row-major
  int rows = 0, columns = 0, inner = 0;
  BufferView<float> a;  // a row has `inner` elements
  BufferView<float> b;  // starts at b_offset, with rows b_pitch apart
  std::size_t b_offset = 0;
  int b_pitch = 0;
  BufferView<float> c;  // out; starts at c_offset, with rows c_pitch apart
  std::size_t c_offset = 0;
  int c_pitch = 0;
};

struct BiasRelu {  // features = max(features + bias, 0)
  BufferView<float> features, bias;
  PlanarSize size;
  std::size_t first = 0;  // element where the first channel starts
  int channels = 0;
};

struct MaxPool {  // windows are clipped at the right and lower edge
  BufferView<float> image;
  PlanarSize size, out_size;
  int channels = 0, window = 1, stride = 1;
  BufferView<float> out;
};

struct LpipsDistance {  // kernels/math/lpips.h, summed over the pixels
  BufferView<float> a, b, weights;
  PlanarSize size;
  int channels = 0;
  BufferView<float> scratch;  // size.plane()
  BufferView<float> sums;     // out: kPartialSums from sums_offset
  int sums_offset = 0;
};

struct ValidSsim {  // 1 - SSIM of one channel, summed over the windows inside the image
  BufferView<float> a, b;
  PlanarSize size;  // at least 11 x 11
  int channel = 0;
  BufferView<float> scratch;  // valid_ssim_scratch(size)
  BufferView<float> sums;     // out: kPartialSums from sums_offset
  int sums_offset = 0;
};
// Number of windows per row and column, and the scratch memory of ValidSsim: four planes of sums and one of
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
  // Returns the size in bytes of the matrix of im2col for which products are fastest. On CPUs the matrix
  // should fit into a core's cache.
  virtual std::size_t matrix_bytes() const = 0;
  // Returns the device memory that matrix_product allocates and keeps. The views may be empty.
  virtual std::size_t product_bytes(const MatrixProduct&) const = 0;
};

// Returns the operations of image metrics other than PSNR and SSIM of a device.
std::unique_ptr<MetricOps> make_metric_ops(Device& device);

}  // namespace ubs
