// SPDX-License-Identifier: Apache-2.0
#include "host/device/ceilings.hpp"

#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {
namespace {

class OpenclCeilings final : public CeilingKernels {
 public:
  explicit OpenclCeilings(OpenclDevice& device)
      : device_(device),
        kernels_(device, {{"map/ceilings.cl"}, {"-DUBS_VW=" + std::to_string(device.vector_width())}}) {}

  unsigned lanes() const override { return device_.vector_width(); }
  std::size_t shared_cache() const override {
    cl_ulong bytes = 0;
    check(clGetDeviceInfo(device_.id(), CL_DEVICE_GLOBAL_MEM_CACHE_SIZE, sizeof bytes, &bytes, nullptr),
          "clGetDeviceInfo");
    return static_cast<std::size_t>(bytes);
  }
  void fma(const CeilingLaunch& l, BufferView<float> out, float factor) override {
    kernels_[kCeilingFma]({l.items}, {l.group}, out, l.rounds, factor);
  }
  void read(const CeilingLaunch& l, BufferView<float> in, BufferView<float> out) override {
    kernels_[kCeilingRead]({l.items}, {l.group}, in, out, l.spacing, l.step, l.count, l.rounds);
  }
  void write(const CeilingLaunch& l, BufferView<float> out, float value) override {
    kernels_[kCeilingWrite]({l.items}, {l.group}, out, l.spacing, l.step, l.count, value);
  }
  void update(const CeilingLaunch& l, BufferView<float> inout, float value) override {
    kernels_[kCeilingUpdate]({l.items}, {l.group}, inout, l.spacing, l.step, l.count, value, l.rounds);
  }

 private:
  OpenclDevice& device_;
  KernelSet kernels_;
};

}  // namespace

std::unique_ptr<CeilingKernels> OpenclDevice::make_ceiling_kernels() {
  return std::make_unique<OpenclCeilings>(*this);
}

}  // namespace ubs::opencl
