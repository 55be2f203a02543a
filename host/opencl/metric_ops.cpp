// SPDX-License-Identifier: Apache-2.0
// The operations of image metrics on an OpenCL device: kernels/map/network.cl and ssim_valid.cl, and CLBlast.
#include "host/device/metric_ops.hpp"

#include "host/device/metric_checks.hpp"
#include "host/opencl/gemm.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {
namespace {

constexpr std::size_t kMatrixBytesCpu = std::size_t{4} << 20, kMatrixBytesGpu = std::size_t{64} << 20;

ProgramSpec program(unsigned width, std::vector<std::string> sources) {
  return {std::move(sources), {"-DUBS_VW=" + std::to_string(width)}};
}

class OpenclMetricOps final : public MetricOps {
 public:
  explicit OpenclMetricOps(OpenclDevice& device)
      : device_(device),
        width_(device.vector_width()),
        network_(device, program(width_, {"math/lpips.h", "map/network.cl"})),
        ssim_(device, program(width_, {"math/loss.h", "map/ssim_valid.cl"})),
        gemm_(device) {}

  void load_image(const LoadImage& a) override {
    check_operation(a);
    const PlanarSize& size = a.image.size;
    network_[kLoadImage](items(size.plane(), 3, 1), {kFlatGroup}, a.image.bytes, a.image.values, size.width,
                         size.height, a.image.pitch, a.image.rows, a.scale[0], a.scale[1], a.scale[2],
                         a.offset[0], a.offset[1], a.offset[2], plane(size), a.out);
  }
  void im2col(const Im2col& a) override {
    check_operation(a);
    network_[kIm2col](items(a.count, a.channels * a.window * a.window, width_), {kFlatGroup}, a.image,
                      a.size.width, a.size.height, plane(a.size), a.window, a.stride, a.padding, a.out_width,
                      a.first, a.count, a.pitch, a.matrix);
  }
  void matrix_product(const MatrixProduct& a) override {
    check_operation(a);
    gemm_(a);
  }
  void bias_relu(const BiasRelu& a) override {
    check_operation(a);
    network_[kBiasRelu](items(a.size.plane(), a.channels, width_), {kFlatGroup}, a.features,
                        static_cast<int>(a.first), a.bias, plane(a.size));
  }
  void max_pool(const MaxPool& a) override {
    check_operation(a);
    network_[kMaxPool](items(a.out_size.pixels(), a.channels, 1), {kFlatGroup}, a.image, a.size.width,
                       a.size.height, plane(a.size), a.window, a.stride, a.out_size.width, a.out_size.height,
                       plane(a.out_size), a.out);
  }
  void lpips_distance(const LpipsDistance& a) override {
    check_operation(a);
    network_[kLpipsDistance](items(a.size.plane(), 1, width_), {kFlatGroup}, a.a, a.b, a.weights, a.channels,
                             static_cast<int>(a.size.pixels()), plane(a.size), a.scratch);
    sum(a.scratch, 0, a.size.plane(), a.sums, a.sums_offset);
  }
  void valid_ssim(const ValidSsim& a) override {
    check_operation(a);
    const PlanarSize windows = valid_windows(a.size);
    const std::size_t pitch = valid_ssim_pitch(a.size), maps = 4 * pitch * a.size.height;
    ssim_[kSsimRows](items(windows.width, a.size.height, width_), {kFlatGroup}, a.a, a.b,
                     static_cast<int>(a.channel * a.size.plane()), a.size.width, a.size.height,
                     static_cast<int>(pitch), a.scratch);
    ssim_[kSsimColumns](items(pitch, windows.height, width_), {kFlatGroup}, a.scratch, a.size.width,
                        a.size.height, static_cast<int>(pitch), static_cast<int>(maps));
    sum(a.scratch, maps, pitch * windows.height, a.sums, a.sums_offset);
  }
  std::size_t matrix_bytes() const override {
    return device_.info().type == DeviceType::cpu ? kMatrixBytesCpu : kMatrixBytesGpu;
  }
  std::size_t product_bytes(const MatrixProduct& a) const override { return gemm_.scratch_bytes(a); }

 private:
  static int plane(const PlanarSize& size) { return static_cast<int>(size.plane()); }
  static Range items(std::size_t elements, int rows, unsigned width) {
    return {round_up((elements + width - 1) / width, kFlatGroup), static_cast<std::size_t>(rows), 1};
  }
  void sum(BufferView<float> values, std::size_t first, std::size_t count, BufferView<float> sums,
           int offset) {
    const int groups = kPartialSums / static_cast<int>(width_);
    network_[kSumInParts](items(static_cast<std::size_t>(groups), 1, 1), {kFlatGroup}, values,
                          static_cast<int>(first), static_cast<int>(count), groups, offset, sums);
  }

  OpenclDevice& device_;
  unsigned width_;  // lanes of a work-item
  KernelSet network_, ssim_;
  Gemm gemm_;
};

}  // namespace

std::unique_ptr<MetricOps> OpenclDevice::make_metric_ops() {
  return std::make_unique<OpenclMetricOps>(*this);
}

}  // namespace ubs::opencl
