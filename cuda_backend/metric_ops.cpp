// SPDX-License-Identifier: Apache-2.0
// The operations of image metrics: the shared kernels of metric_kernels.cu, and cuBLAS.
#include "host/device/metric_ops.hpp"

#include "cuda_backend/cuda_device.hpp"
#include "cuda_backend/gemm.hpp"
#include "cuda_backend/grid.hpp"
#include "cuda_backend/kernels.hpp"
#include "host/device/metric_checks.hpp"

namespace ubs::cuda {
namespace {

constexpr std::size_t kMatrixBytes = std::size_t{64} << 20;

class CudaMetricOps final : public MetricOps {
 public:
  explicit CudaMetricOps(CudaDevice& device) : device_(device), kernels_(metric_kernels()) {}

  void load_image(const LoadImage& a) override {
    check_operation(a);
    const PlanarSize& size = a.image.size;
    device_.launch("load_image", kernels_.load_image, items(size.plane(), 3), kMapBlock, a.image.bytes,
                   a.image.values, size.width, size.height, a.image.pitch, a.image.rows, a.scale[0],
                   a.scale[1], a.scale[2], a.offset[0], a.offset[1], a.offset[2], plane(size), a.out);
  }
  void im2col(const Im2col& a) override {
    check_operation(a);
    device_.launch("im2col", kernels_.im2col,
                   items(static_cast<std::size_t>(a.count), a.channels * a.window * a.window), kMapBlock,
                   a.image, a.size.width, a.size.height, plane(a.size), a.window, a.stride, a.padding,
                   a.out_width, a.first, a.count, a.pitch, a.matrix);
  }
  void matrix_product(const MatrixProduct& a) override {
    check_operation(a);
    if (!gemm_) gemm_ = make_gemm(device_);
    device_.call("matrix_product", [&] { return (*gemm_)(a); });
  }
  void bias_relu(const BiasRelu& a) override {
    check_operation(a);
    device_.launch("bias_relu", kernels_.bias_relu, items(a.size.plane(), a.channels), kMapBlock, a.features,
                   static_cast<int>(a.first), a.bias, plane(a.size));
  }
  void max_pool(const MaxPool& a) override {
    check_operation(a);
    device_.launch("max_pool", kernels_.max_pool, items(a.out_size.pixels(), a.channels), kMapBlock, a.image,
                   a.size.width, a.size.height, plane(a.size), a.window, a.stride, a.out_size.width,
                   a.out_size.height, plane(a.out_size), a.out);
  }
  void lpips_distance(const LpipsDistance& a) override {
    check_operation(a);
    device_.launch("lpips_distance", kernels_.lpips_distance, items(a.size.plane(), 1), kMapBlock, a.a, a.b,
                   a.weights, a.channels, static_cast<int>(a.size.pixels()), plane(a.size), a.scratch);
    sum(a.scratch, 0, a.size.plane(), a.sums, a.sums_offset);
  }
  void valid_ssim(const ValidSsim& a) override {
    check_operation(a);
    const PlanarSize windows = valid_windows(a.size);
    const std::size_t pitch = valid_ssim_pitch(a.size),
                      maps = 4 * pitch * static_cast<std::size_t>(a.size.height);
    device_.launch("ssim_rows", kernels_.ssim_rows,
                   items(static_cast<std::size_t>(windows.width), a.size.height), kMapBlock, a.a, a.b,
                   static_cast<int>(static_cast<std::size_t>(a.channel) * a.size.plane()), a.size.width,
                   a.size.height, static_cast<int>(pitch), a.scratch);
    device_.launch("ssim_columns", kernels_.ssim_columns, items(pitch, windows.height), kMapBlock, a.scratch,
                   a.size.width, a.size.height, static_cast<int>(pitch), static_cast<int>(maps));
    sum(a.scratch, maps, pitch * static_cast<std::size_t>(windows.height), a.sums, a.sums_offset);
  }
  std::size_t matrix_bytes() const override { return kMatrixBytes; }
  std::size_t product_bytes(const MatrixProduct&) const override { return 0; }  // cuBLAS's own is not counted

 private:
  static int plane(const PlanarSize& size) { return static_cast<int>(size.plane()); }
  static dim3 items(std::size_t elements, int rows) {
    return {blocks(elements, kMapBlock), static_cast<unsigned>(rows), 1};
  }
  void sum(BufferView<float> values, std::size_t first, std::size_t count, BufferView<float> sums,
           int offset) {
    device_.launch("partial_sums", kernels_.partial_sums, items(kPartialSums, 1), kMapBlock, values,
                   static_cast<int>(first), static_cast<int>(count), kPartialSums, offset, sums);
  }

  CudaDevice& device_;
  MetricKernels kernels_;
  std::unique_ptr<Gemm> gemm_;  // made with the first product
};

}  // namespace

std::unique_ptr<MetricOps> CudaDevice::make_metric_ops() { return std::make_unique<CudaMetricOps>(*this); }

}  // namespace ubs::cuda
