// SPDX-License-Identifier: Apache-2.0
// Kernel sources from the project's folder instead of the embedded ones, so that a test can add its own.
#pragma once

#include <cstdlib>

namespace ubs::test {

struct KernelFolder {  // until the end of its life
  KernelFolder() { setenv("UBS_KERNEL_DIR", UBS_SOURCE_DIR "/kernels", 1); }
  ~KernelFolder() { unsetenv("UBS_KERNEL_DIR"); }
};

}  // namespace ubs::test
