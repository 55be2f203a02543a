// SPDX-License-Identifier: Apache-2.0
// CudaMetricOps runs the operations of image metrics: the kernels of metric_kernels.cu, and matrix products
// with cuBLAS.
#include "cuda_backend/cuda_gemm.hpp"
#include "cuda_backend/grid.hpp"
#include "host/device/map_metric_ops.hpp"

namespace ubs::cuda {
namespace {

constexpr std::size_t kMatrixBytes = std::size_t{64} << 20;

class CudaMetricOps final : public MapMetricOps<MapKernels<MetricKernels>> {
 public:
  explicit CudaMetricOps(CudaDevice& device)
      : MapMetricOps({device, metric_kernels}, {device, metric_kernels}), device_(device) {}

  void matrix_product(const MatrixProduct& a) override {
    if (!gemm_) gemm_ = make_gemm(device_);
    device_.call("matrix_product", [&] { return (*gemm_)(a); });
  }
  std::size_t matrix_bytes() const override { return kMatrixBytes; }
  // Does not count the memory that cuBLAS allocates for itself.
  std::size_t product_bytes(const MatrixProduct&) const override { return 0; }

 private:
  CudaDevice& device_;
  std::unique_ptr<Gemm> gemm_;  // created by the first product
};

}  // namespace

std::unique_ptr<MetricOps> CudaDevice::make_metric_ops() { return std::make_unique<CudaMetricOps>(*this); }

}  // namespace ubs::cuda
