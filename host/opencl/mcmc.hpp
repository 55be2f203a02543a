// SPDX-License-Identifier: Apache-2.0
// Stages Relocate, Grow, AddNoise, SamplingWeights and SplitSources on OpenCL. Everything is decided on the
// device; only relocate waits, for the number of splats that moved.
#pragma once

#include "host/opencl/scan.hpp"

namespace ubs::opencl {

class Mcmc {
 public:
  Mcmc(OpenclDevice& device, const KernelConfig& config);
  std::uint32_t relocate(const Relocate& stage);
  void grow(const Grow& stage);
  void add_noise(const AddNoise& stage);
  void weigh(const SamplingWeights& stage);
  void split(const SplitSources& stage);

 private:
  struct Draw {  // slot i of first .. first + slots - 1 draws number i
    std::uint32_t first, slots, purpose;
    bool alive_only;
    std::uint64_t seed, iteration;
  };
  void replace(const SplatView& splats, BufferView<float> moment1, BufferView<float> moment2,
               const Draw& draw);
  void reserve_scratch(std::uint32_t count, std::uint32_t slots);

  OpenclDevice& device_;
  unsigned width_;    // lanes of a work-item of the noise kernel
  std::size_t rows_;  // parameters of a splat
  Scan scan_;
  KernelSet kernels_, noise_;
  Buffer<std::uint32_t> weights_, copy_counts_, source_ids_, totals_;
  Buffer<std::uint64_t> prefix_;
};

}  // namespace ubs::opencl
