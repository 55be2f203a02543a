// SPDX-License-Identifier: Apache-2.0
// While an object of the class LenientKernels exists, ubs uses changed kernels that render splats with any
// finite parameters. The original kernels cull splats with parameters above UBS_RAW_MAX (kernels/limits.h),
// because their gradients would not be finite. Gradients that are not finite may still have other causes.
// Tests produce them with the changed kernels, and check how ubs handles them. Devices must be opened after
// the object is created.
#pragma once

#include <cstdlib>

#include "tests/support/changed_kernels.hpp"

namespace ubs::test {

class LenientKernels {
 public:
  LenientKernels() {
    const auto copy = changed_kernels(folder_, "map/project.cl",
                                      "even + odd <= (vreal)(UBS_RAW_MAX * UBS_RAW_MAX)", "even == even");
    ::setenv("UBS_KERNEL_DIR", copy.c_str(), 1);
  }
  ~LenientKernels() { ::unsetenv("UBS_KERNEL_DIR"); }
  LenientKernels(const LenientKernels&) = delete;
  LenientKernels& operator=(const LenientKernels&) = delete;

 private:
  TempFolder folder_;
};

}  // namespace ubs::test
