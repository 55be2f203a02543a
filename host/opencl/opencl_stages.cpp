// SPDX-License-Identifier: Apache-2.0
// The stage interface on an OpenCL device: each operation is handed to the class that owns its kernels.
#include "host/opencl/image_loss.hpp"
#include "host/opencl/lists.hpp"
#include "host/opencl/mcmc.hpp"
#include "host/opencl/optimiser.hpp"
#include "host/opencl/platform.hpp"
#include "host/opencl/projection.hpp"
#include "host/opencl/raster.hpp"

namespace ubs::opencl {
namespace {

// Where the host has other work to do next, or may have, it flushes: some drivers begin with what is enqueued
// only when there is much of it, or when they are asked to.
class OpenclStages final : public Stages {
 public:
  OpenclStages(OpenclDevice& device, const KernelConfig& config)
      : device_(device),
        config_(config),
        projection_(device, config),
        lists_(device, config),
        raster_(device, config),
        loss_(device, config),
        optimiser_(device, config),
        mcmc_(device, config) {}

  const KernelConfig& config() const override { return config_; }
  void project_forward(const ProjectForward& a) override { projection_.forward(a); }
  ListTotals count_lists(const CountLists& a) override { return lists_.count(a); }
  void build_lists(const BuildLists& a) override {
    lists_.build(a);
    device_.flush();
  }
  void raster_forward(const RasterForward& a) override {
    raster_.forward(a);
    device_.flush();
  }
  void image_loss(const ImageLoss& a) override { loss_.run(a); }
  void raster_backward(const RasterBackward& a) override {
    raster_.backward(a);
    device_.flush();
  }
  void sum_slots(const SumSlots& a) override { raster_.sum_slots(a); }
  void project_backward(const ProjectBackward& a) override { projection_.backward(a); }
  void regularise(const Regularise& a) override { optimiser_.regularise(a); }
  void adam(const AdamStep& a) override {
    optimiser_.adam(a);
    device_.flush();
  }
  void learn(const Learn& a) override {
    projection_.learn(a);
    device_.flush();
  }
  std::uint32_t relocate(const Relocate& a) override { return mcmc_.relocate(a); }
  void grow(const Grow& a) override { mcmc_.grow(a); }
  void add_noise(const AddNoise& a) override { mcmc_.add_noise(a); }
  void measure_weights(const MeasureWeights& a) override { raster_.measure_weights(a); }

 private:
  OpenclDevice& device_;
  KernelConfig config_;
  Projection projection_;
  Lists lists_;
  Raster raster_;
  ImageLossKernels loss_;
  Optimiser optimiser_;
  Mcmc mcmc_;
};

}  // namespace

std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config) {
  auto* opencl_device = dynamic_cast<OpenclDevice*>(&device);
  if (!opencl_device) return nullptr;
  check_approximation(config);
  return std::make_unique<OpenclStages>(*opencl_device, config);
}

}  // namespace ubs::opencl
