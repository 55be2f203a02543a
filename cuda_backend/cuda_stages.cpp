// SPDX-License-Identifier: Apache-2.0
// The stage interface on a CUDA device: each operation is handed to the class that owns its kernels.
#include "cuda_backend/appearance.hpp"
#include "cuda_backend/cuda_device.hpp"
#include "cuda_backend/drawn.hpp"
#include "cuda_backend/image_loss.hpp"
#include "cuda_backend/lists.hpp"
#include "cuda_backend/parameters.hpp"
#include "cuda_backend/raster.hpp"
#include "cuda_backend/sky.hpp"
#include "host/device/kernel_options.hpp"

namespace ubs::cuda {
namespace {

class CudaStages final : public Stages {
 public:
  CudaStages(CudaDevice& device, const KernelConfig& config)
      : config_(config),
        parameters_(device, config),
        lists_(device),
        raster_(device, config),
        loss_(device),
        appearance_(device),
        sky_(device),
        drawn_(device) {}

  const KernelConfig& config() const override { return config_; }
  Outcome run(const Operation& operation) override {
    return run_case(
        operation, [&](const ProjectForward& a) { parameters_.project_forward(a); },
        [&](const CountLists& a) { return lists_.count(a); }, [&](const BuildLists& a) { lists_.build(a); },
        [&](const RasterForward& a) { raster_.forward(a); },
        [&](const ImageLoss& a) {
          if (a.appearance.size == 0) return loss_.run(a);
          ImageLoss mapped = a;
          mapped.image = appearance_.map(a);
          loss_.run(mapped);
          if (a.v_image.size > 0) appearance_.gradient(a);
        },
        [&](const RasterBackward& a) { raster_.backward(a); },
        [&](const SumSlots& a) { raster_.sum_slots(a); },
        [&](const ProjectBackward& a) { parameters_.project_backward(a); },
        [&](const Regularise& a) { parameters_.regularise(a); },
        [&](const AdamStep& a) { parameters_.adam(a); },
        [&](const Learn& a) {
          parameters_.project_backward(a.gradient);
          parameters_.regularise(a.penalty);
          parameters_.adam(a.step);
        },
        [&](const Relocate& a) { return parameters_.relocate(a); },
        [&](const Grow& a) { parameters_.grow(a); }, [&](const AddNoise& a) { parameters_.add_noise(a); },
        [&](const MeasureWeights& a) { raster_.measure_weights(a); },
        [&](const CameraBackward& a) { parameters_.camera_backward(a); },
        [&](const AppearanceStep& a) { appearance_.step(a); },
        [&](const SamplingWeights& a) { parameters_.weigh(a); },
        [&](const SplitSources& a) { parameters_.split(a); }, [&](const DrawSky& a) { sky_.draw(a); },
        [&](const SkyGradient& a) { sky_.gradient(a); }, [&](const SkyStep& a) { sky_.step(a); },
        [&](const PlaceDrawn& a) { return drawn_.place(a); }, [&](const PickDrawn& a) { drawn_.pick(a); },
        [&](const UnpackDrawn& a) { drawn_.unpack(a); }, [&](const SpreadGradient& a) { drawn_.spread(a); });
  }

 private:
  KernelConfig config_;
  Parameters parameters_;
  Lists lists_;
  Raster raster_;
  ImageLossKernels loss_;
  Appearance appearance_;
  Sky sky_;
  Drawn drawn_;
};

}  // namespace

std::unique_ptr<Stages> CudaDevice::make_stages(const KernelConfig& config) {
  return std::make_unique<CudaStages>(*this, config);
}

}  // namespace ubs::cuda
