// SPDX-License-Identifier: Apache-2.0
// Draws cases and takes their gradients on a device. Kernels are compiled once a form of the method; buffers
// stay between cases.
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
  SplatModel gradient;       // of sum(weights * image), in the place of each parameter
  ListTotals totals;
};

bool same_bits(std::span<const float> a, std::span<const float> b);

class DeviceRunner {
 public:
  DeviceRunner(Device& device, RasterKind raster);
  ~DeviceRunner();

  // weights: (3, H, W); empty: only the image. Throws Error(memory) as rendering does.
  DeviceResult run(const Case& c, const std::vector<float>& weights);
  // Stages and renderer of a form of the method, for rows that drive stages themselves.
  Stages& stages(int dim, const ModelVariant& variant = {}, bool query_grad = false);
  Device& device() { return device_; }
  RasterKind raster() const { return raster_; }

  // Called on every result before it is judged: a fault put in by a test must be found.
  std::function<void(const Case&, DeviceResult&)> disturb;

 private:
  struct Form;
  Form& form(int dim, const ModelVariant& variant, bool query_grad);

  Device& device_;
  RasterKind raster_;
  std::map<std::tuple<int, std::array<int, kVariantSwitches.size()>, bool>, std::unique_ptr<Form>> forms_;
};

}  // namespace ubs::stress
