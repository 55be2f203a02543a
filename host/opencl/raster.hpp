// SPDX-License-Identifier: Apache-2.0
// The rasterisers and the sum over slots: picks the kernels of KernelConfig::raster and launches them.
// Contracts: RasterForward, RasterBackward and SumSlots in host/device/stages.hpp.
#pragma once

#include <map>
#include <optional>

#include "host/opencl/core_groups.hpp"
#include "host/opencl/exchange.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

class Raster {
 public:
  Raster(OpenclDevice& device, const KernelConfig& config);

  void run(const RasterForward& work);
  void run(const RasterBackward& work);
  void run(const SumSlots& work);
  void run(const MeasureWeights& work);

 private:
  Exchange exchange();
  KernelSet& raster(bool pieces);  // of slots in several

  OpenclDevice& device_;
  KernelConfig config_;
  std::map<bool, KernelSet> raster_;  // by whether slots are in several pieces
  std::optional<Exchange> exchange_;  // once asked for
  CoreGroups core_groups_;
  std::size_t sum_group_;
  KernelSet weights_;
  Buffer<float> parts_;  // of long lists
};

}  // namespace ubs::opencl
