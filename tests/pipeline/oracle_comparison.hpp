// SPDX-License-Identifier: Apache-2.0
// Compares one view on one device and rasteriser with the float64 oracle: image, alpha, depth, and the
// gradient of the loss by parameter group. Errors are printed.
#pragma once

#include <string>

#include "host/device/registry.hpp"
#include "host/lab/oracle/scenes.hpp"

namespace ubs::test {

struct Case {
  Device& device;
  KernelConfig config;  // its variant must be that of the scene
  std::string name;
};

std::string text(RasterKind kind);

// bound: limit of the absolute error of image and alpha, and of the relative 2-norm error of the depth.
void compare_forward(const Case& c, const std::string& name, const oracle::Scene& scene, double bound);
// bound: limit of the relative 2-norm error of each parameter group.
void compare_gradient(const Case& c, const std::string& name, const oracle::Scene& scene, double bound,
                      bool expect_gradient = true);

}  // namespace ubs::test
