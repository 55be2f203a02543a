// SPDX-License-Identifier: Apache-2.0
// The stages with one thread a splat or parameter: projection, optimiser and penalties, relocation, growth
// and noise.
#pragma once

#include <optional>

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Parameters {
 public:
  Parameters(CudaDevice& device, const KernelConfig& config);

  void project_forward(const ProjectForward& args);
  void project_backward(const ProjectBackward& args);
  void camera_backward(const CameraBackward& args);
  void regularise(const Regularise& args);
  void adam(const AdamStep& args);
  std::uint32_t relocate(const Relocate& args);  // waits for the number of splats moved
  void grow(const Grow& args);
  void add_noise(const AddNoise& args);
  void weigh(const SamplingWeights& args);
  void split(const SplitSources& args);

 private:
  struct Draw {  // slot i of first .. first + slots - 1 draws number i
    u32 first, slots, purpose;
    bool alive_only;
    std::uint64_t seed, iteration;
  };
  void replace(const SplatView& splats, BufferView<float> moment1, BufferView<float> moment2,
               const Draw& draw);

  dim3 items(u32 count, std::size_t rows = 1) const;

  // Made at their first use: a rendering does without.
  const ParameterKernels& kernels();

  CudaDevice& device_;
  KernelConfig config_;
  std::size_t rows_, trained_rows_;  // of parameters; of gradients and moments
  ProjectKernels project_;
  CameraKernels camera_;  // with their first use
  std::optional<ParameterKernels> kernels_;
  unsigned block_;  // threads
  Buffer<u32> weights_, copy_counts_, source_ids_, totals_;
  Buffer<std::uint64_t> prefix_;
};

}  // namespace ubs::cuda
