// SPDX-License-Identifier: Apache-2.0
#include "host/device/ceilings.hpp"

#include "cuda_backend/cuda_device.hpp"
#include "cuda_backend/grid.hpp"

namespace ubs::cuda {
namespace {

class CudaCeilings final : public CeilingKernels {
 public:
  explicit CudaCeilings(CudaDevice& device) : device_(device), kernels_(ceiling_functions()) {}

  unsigned lanes() const override { return 1; }
  std::size_t shared_cache() const override { return device_.cache_bytes(); }
  void fma(const CeilingLaunch& l, BufferView<float> out, float factor) override {
    device_.launch("ceiling_fma", kernels_.fma, grid(l), block(l), out, l.rounds, factor);
  }
  void read(const CeilingLaunch& l, BufferView<float> in, BufferView<float> out) override {
    device_.launch("ceiling_read", kernels_.read, grid(l), block(l), in, out, l.spacing, l.step, l.count,
                   l.rounds);
  }
  void write(const CeilingLaunch& l, BufferView<float> out, float value) override {
    device_.launch("ceiling_write", kernels_.write, grid(l), block(l), out, l.spacing, l.step, l.count,
                   value);
  }
  void update(const CeilingLaunch& l, BufferView<float> inout, float value) override {
    device_.launch("ceiling_update", kernels_.update, grid(l), block(l), inout, l.spacing, l.step, l.count,
                   value, l.rounds);
  }

 private:
  static unsigned block(const CeilingLaunch& l) { return static_cast<unsigned>(l.group); }
  static dim3 grid(const CeilingLaunch& l) { return {blocks(l.items, block(l)), 1, 1}; }

  CudaDevice& device_;
  CeilingFunctions kernels_;
};

}  // namespace

std::unique_ptr<CeilingKernels> CudaDevice::make_ceiling_kernels() {
  return std::make_unique<CudaCeilings>(*this);
}

}  // namespace ubs::cuda
