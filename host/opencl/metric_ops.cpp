// SPDX-License-Identifier: Apache-2.0
// This file implements the operations of image metrics on an OpenCL device, with kernels/map/network.cl,
// kernels/map/ssim_valid.cl and CLBlast.
#include "host/device/map_metric_ops.hpp"
#include "host/opencl/gemm.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {
namespace {

// These are the results of matrix_bytes() on CPUs and on GPUs.
constexpr std::size_t kMatrixBytesCpu = std::size_t{4} << 20, kMatrixBytesGpu = std::size_t{64} << 20;

class OpenclMetricOps final : public MapMetricOps<MapKernels> {
 public:
  explicit OpenclMetricOps(OpenclDevice& device)
      : MapMetricOps({device, device.vector_width(), {"math/lpips.h", "map/network.cl"}},
                     {device, device.vector_width(), {"math/loss.h", "map/ssim_valid.cl"}}),
        device_(device),
        gemm_(device) {}

  void matrix_product(const MatrixProduct& a) override { gemm_(a); }
  std::size_t matrix_bytes() const override {
    return device_.info().type == DeviceType::cpu ? kMatrixBytesCpu : kMatrixBytesGpu;
  }
  std::size_t product_bytes(const MatrixProduct& a) const override { return gemm_.scratch_bytes(a); }

 private:
  OpenclDevice& device_;
  Gemm gemm_;
};

}  // namespace

std::unique_ptr<MetricOps> OpenclDevice::make_metric_ops() {
  return std::make_unique<OpenclMetricOps>(*this);
}

}  // namespace ubs::opencl
