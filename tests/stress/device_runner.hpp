// SPDX-License-Identifier: Apache-2.0
// DeviceRunner renders cases of stress tests and computes their gradients on a device. It compiles kernels
// once per variant, and reuses buffers for all cases.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <span>
#include <tuple>

#include "host/device/registry.hpp"
#include "tests/stress/case.hpp"

namespace ubs::stress {

struct DeviceResult {
  std::vector<float> image;  // (3, H, W)
  std::vector<float> alpha;  // (H, W)
  // The derivatives of sum(weights * image) with respect to the parameters, in the layout of the parameters.
  SplatModel gradient;
  ListTotals totals;
};

// Returns whether both spans have the same size and the same bits. NaNs with equal bits are equal.
bool same_bits(std::span<const float> a, std::span<const float> b);

class DeviceRunner {
 public:
  DeviceRunner(Device& device, RasterKind raster);
  ~DeviceRunner();

  // Renders a case. `weights` are (3, H, W); if they are empty, only the image is computed. Throws
  // Error(memory) if the device has too little memory.
  DeviceResult run(const Case& c, const std::vector<float>& weights);
  // Returns the stages of a variant, for stress tests that call stages directly.
  Stages& stages(int dim, const ModelVariant& variant = {}, bool query_grad = false);
  Device& device() { return device_; }
  RasterKind raster() const { return raster_; }

  // This function is called with every result before it is compared. Tests use it to introduce faults, which
  // must then be detected.
  std::function<void(const Case&, DeviceResult&)> disturb;

 private:
  struct Form;
  Form& form(int dim, const ModelVariant& variant, bool query_grad);

  Device& device_;
  RasterKind raster_;
  std::map<std::tuple<int, std::array<int, kVariantSwitches.size()>, bool>, std::unique_ptr<Form>> forms_;
};

}  // namespace ubs::stress
