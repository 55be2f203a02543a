// SPDX-License-Identifier: Apache-2.0
// KernelFolder makes ubs read the kernel sources from the folder of the project instead of the embedded ones,
// so that a test can add its own.
#pragma once

#include <cstdlib>

namespace ubs::test {

struct KernelFolder {  // as long as the object exists
  KernelFolder() { setenv("UBS_KERNEL_DIR", UBS_SOURCE_DIR "/kernels", 1); }
  ~KernelFolder() { unsetenv("UBS_KERNEL_DIR"); }
};

}  // namespace ubs::test
