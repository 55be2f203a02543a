// SPDX-License-Identifier: Apache-2.0
// Raster runs the forward and the backward rasteriser, adds up the gradient slots of each splat, and measures
// how much each splat contributes to the pixels. It launches the kernels that KernelConfig::raster selects.
// The operations RasterForward, RasterBackward, SumSlots and MeasureWeights are described in
// host/device/stages.hpp.
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
  Exchange exchange();             // returns the mechanism with which lanes exchange values
  KernelSet& raster(bool pieces);  // `pieces` is true if the slots are in several buffers

  OpenclDevice& device_;
  KernelConfig config_;
  std::map<bool, KernelSet> raster_;  // the key is true if the slots are in several buffers
  std::optional<Exchange> exchange_;  // set at the first use
  CoreGroups core_groups_;
  std::size_t sum_group_;
  KernelSet weights_;
  Buffer<float> parts_;  // results of the parts of long lists
};

}  // namespace ubs::opencl
