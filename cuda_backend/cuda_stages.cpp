// SPDX-License-Identifier: Apache-2.0
// Implements Stages, the interface for the operations of a training step, on a CUDA device.
#include "cuda_backend/cuda_device.hpp"
#include "cuda_backend/cuda_image_loss.hpp"
#include "cuda_backend/cuda_lists.hpp"
#include "cuda_backend/cuda_projection.hpp"
#include "cuda_backend/cuda_raster.hpp"
#include "cuda_backend/grid.hpp"
#include "cuda_backend/kernel_choice.hpp"
#include "host/device/backend.hpp"

namespace ubs::cuda {
namespace {

using Appearance = AppearanceStages<MapKernels<AppearanceTable>>;
using Sky = SkyStages<MapKernels<SkyTable>>;
using ImageGradients = ImageGradientStages<MapKernels<ImageGradientTable>>;
using Drawn = DrawnStages<MapKernels<DrawnTable>, Sums>;
using ParameterChanges = ParameterStages<MapKernels<ParameterKernels>, Sums>;

MapKernels<ParameterKernels> parameters(CudaDevice& device, const KernelConfig& config) {
  return {device, [&device, config] { return parameter_kernels(device, config); }, map_block(device)};
}

// Each base class has run() for some of the operations, and launches their kernels.
struct Kernels : Projection,
                 Lists,
                 Raster,
                 ImageLossKernels,
                 Appearance,
                 Sky,
                 ParameterChanges,
                 ImageGradients,
                 Drawn {
  Kernels(CudaDevice& device, const KernelConfig& config)
      : Projection(device, config),
        Lists(device),
        Raster(device, config),
        ImageLossKernels(device),
        Appearance(device, {device, appearance_kernels}, {device, appearance_kernels}),
        Sky(device, {device, sky_kernels}, {device, sky_kernels}),
        ParameterChanges(device, config, parameters(device, config), parameters(device, config),
                         Sums(device)),
        ImageGradients(device, {device, image_gradient_kernels}),
        Drawn(device, {device, drawn_kernels}, Sums(device)) {}

  using Projection::run, Lists::run, Raster::run, Appearance::run, Sky::run, ParameterChanges::run,
      ImageGradients::run, Drawn::run;
  void run(const ImageLoss& a) {
    with_colours(a, [&](const ImageLoss& mapped) { ImageLossKernels::run(mapped); });
  }
  void run(const Learn& a) {
    run(a.gradient);
    run(a.penalty);
    run(a.step);
  }
};

class CudaStages final : public Stages {
 public:
  CudaStages(CudaDevice& device, const KernelConfig& config) : config_(config), kernels_(device, config) {
    config_.raster = RasterKind::gpu;  // the only kind in CUDA
  }

  const KernelConfig& config() const override { return config_; }
  Outcome run(const Operation& operation) override {
    return run_case(operation, [&](const auto& a) { return kernels_.run(a); });
  }

 private:
  KernelConfig config_;
  Kernels kernels_;
};

}  // namespace

std::unique_ptr<Stages> CudaDevice::make_stages(const KernelConfig& config) {
  return std::make_unique<CudaStages>(*this, config);
}

}  // namespace ubs::cuda
