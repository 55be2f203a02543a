// SPDX-License-Identifier: Apache-2.0
// The stage interface on a CUDA device: each operation is handed to the class that owns its kernels.
#include "cuda_backend/image_loss.hpp"
#include "cuda_backend/lists.hpp"
#include "cuda_backend/parameters.hpp"
#include "cuda_backend/platform.hpp"
#include "cuda_backend/raster.hpp"
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
        loss_(device) {}

  const KernelConfig& config() const override { return config_; }
  void project_forward(const ProjectForward& a) override { parameters_.project_forward(a); }
  ListTotals count_lists(const CountLists& a) override { return lists_.count(a); }
  void build_lists(const BuildLists& a) override { lists_.build(a); }
  void raster_forward(const RasterForward& a) override { raster_.forward(a); }
  void image_loss(const ImageLoss& a) override { loss_.run(a); }
  void raster_backward(const RasterBackward& a) override { raster_.backward(a); }
  void sum_slots(const SumSlots& a) override { raster_.sum_slots(a); }
  void project_backward(const ProjectBackward& a) override { parameters_.project_backward(a); }
  void regularise(const Regularise& a) override { parameters_.regularise(a); }
  void adam(const AdamStep& a) override { parameters_.adam(a); }
  std::uint32_t relocate(const Relocate& a) override { return parameters_.relocate(a); }
  void grow(const Grow& a) override { parameters_.grow(a); }
  void add_noise(const AddNoise& a) override { parameters_.add_noise(a); }
  void measure_weights(const MeasureWeights& a) override { raster_.measure_weights(a); }

 private:
  KernelConfig config_;
  Parameters parameters_;
  Lists lists_;
  Raster raster_;
  ImageLossKernels loss_;
};

}  // namespace

std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config) {
  auto* cuda_device = dynamic_cast<CudaDevice*>(&device);
  if (!cuda_device) return nullptr;
  check_approximation(config);
  return std::make_unique<CudaStages>(*cuda_device, config);
}

}  // namespace ubs::cuda
