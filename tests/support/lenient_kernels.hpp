// SPDX-License-Identifier: Apache-2.0
// While it lives, kernels are read from a copy that draws splats of any finite parameters. The product culls
// those beyond UBS_RAW_MAX, whose gradients are not finite (kernels/limits.h); what it does about such
// gradients, whatever their origin, is tested with this. Devices must be opened after it.
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
