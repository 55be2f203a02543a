// SPDX-License-Identifier: Apache-2.0
// KernelFolder makes ubs read the kernel sources from the folder of the project instead of the embedded ones,
// so that a test can add kernels.
#pragma once

#include <cstdlib>

#include "tests/support/source_folder.hpp"

namespace ubs::test {

struct KernelFolder {  // the effect lasts as long as the object exists
  KernelFolder() { setenv("UBS_KERNEL_DIR", (source_folder() / "kernels").c_str(), 1); }
  ~KernelFolder() { unsetenv("UBS_KERNEL_DIR"); }
};

}  // namespace ubs::test
