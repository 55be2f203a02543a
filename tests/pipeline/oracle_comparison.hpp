// SPDX-License-Identifier: Apache-2.0
// Declares functions that render one view on one device with one rasteriser, and compare the results with
// those of the float64 oracle: the image, alpha, depth, and the gradient of the loss for each parameter
// group. The functions print the errors.
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

// Returns "cpu" or "gpu".
std::string text(RasterKind kind);

// Compares image and alpha, and the depth if the configuration has depth. `name` labels the printed errors.
// `bound` limits the absolute errors of image and alpha, and the relative 2-norm error of the depth.
void compare_forward(const Case& c, const std::string& name, const oracle::Scene& scene, double bound);
// Compares the gradient of the training loss. `bound` limits the relative 2-norm error of each parameter
// group. If `expect_gradient` is true, the expected gradient must not be zero.
void compare_gradient(const Case& c, const std::string& name, const oracle::Scene& scene, double bound,
                      bool expect_gradient = true);

}  // namespace ubs::test
