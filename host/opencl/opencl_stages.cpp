// SPDX-License-Identifier: Apache-2.0
// The stage interface on an OpenCL device: each operation is handed to the class that owns its kernels.
#include "host/opencl/appearance.hpp"
#include "host/opencl/drawn.hpp"
#include "host/opencl/image_loss.hpp"
#include "host/opencl/lists.hpp"
#include "host/opencl/mcmc.hpp"
#include "host/opencl/optimiser.hpp"
#include "host/opencl/projection.hpp"
#include "host/opencl/raster.hpp"
#include "host/opencl/sky.hpp"

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
        appearance_(device, config),
        sky_(device, config),
        optimiser_(device, config),
        mcmc_(device, config),
        drawn_(device, config) {}

  const KernelConfig& config() const override { return config_; }
  Outcome run(const Operation& operation) override {
    return run_case(
        operation, [&](const ProjectForward& a) { projection_.forward(a); },
        [&](const CountLists& a) { return lists_.count(a); },
        [&](const BuildLists& a) {
          lists_.build(a);
          device_.flush();
        },
        [&](const RasterForward& a) {
          raster_.forward(a);
          device_.flush();
        },
        [&](const ImageLoss& a) {
          if (a.appearance.size == 0) return loss_.run(a);
          ImageLoss mapped = a;
          mapped.image = appearance_.map(a);
          loss_.run(mapped);
          if (a.v_image.size > 0) appearance_.gradient(a);
        },
        [&](const RasterBackward& a) {
          raster_.backward(a);
          device_.flush();
        },
        [&](const SumSlots& a) { raster_.sum_slots(a); },
        [&](const ProjectBackward& a) { projection_.backward(a); },
        [&](const Regularise& a) { optimiser_.regularise(a); },
        [&](const AdamStep& a) {
          optimiser_.adam(a);
          device_.flush();
        },
        [&](const Learn& a) {
          projection_.learn(a);
          device_.flush();
        },
        [&](const Relocate& a) { return mcmc_.relocate(a); }, [&](const Grow& a) { mcmc_.grow(a); },
        [&](const AddNoise& a) { mcmc_.add_noise(a); },
        [&](const MeasureWeights& a) { raster_.measure_weights(a); },
        [&](const CameraBackward& a) { projection_.camera_backward(a); },
        [&](const AppearanceStep& a) { appearance_.step(a); },
        [&](const SamplingWeights& a) { mcmc_.weigh(a); }, [&](const SplitSources& a) { mcmc_.split(a); },
        [&](const DrawSky& a) { sky_.draw(a); }, [&](const SkyGradient& a) { sky_.gradient(a); },
        [&](const SkyStep& a) { sky_.step(a); }, [&](const PlaceDrawn& a) { return drawn_.place(a); },
        [&](const PickDrawn& a) { drawn_.pick(a); }, [&](const UnpackDrawn& a) { drawn_.unpack(a); },
        [&](const SpreadGradient& a) { drawn_.spread(a); });
  }

 private:
  OpenclDevice& device_;
  KernelConfig config_;
  Projection projection_;
  Lists lists_;
  Raster raster_;
  ImageLossKernels loss_;
  AppearanceKernels appearance_;
  SkyKernels sky_;
  Optimiser optimiser_;
  Mcmc mcmc_;
  DrawnKernels drawn_;
};

}  // namespace

std::unique_ptr<Stages> OpenclDevice::make_stages(const KernelConfig& config) {
  return std::make_unique<OpenclStages>(*this, config);
}

}  // namespace ubs::opencl
