// SPDX-License-Identifier: Apache-2.0
// LenientKernels makes ubs read the kernels from a copy that renders splats with any finite parameters. The
// effect lasts as long as the object exists. The product culls splats beyond UBS_RAW_MAX, because their
// gradients are not finite (kernels/limits.h). With these kernels, tests check how the product handles such
// gradients, which may also have other causes. Devices must be opened after the object is created.
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
