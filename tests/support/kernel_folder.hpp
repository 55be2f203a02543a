// SPDX-License-Identifier: Apache-2.0
// While a KernelFolder exists, ubs reads kernel sources from the folder of the project instead of using the
// embedded ones, so that tests can compile their own kernels.
#pragma once

#include <cstdlib>

#include "tests/support/source_folder.hpp"

namespace ubs::test {

struct KernelFolder {
  KernelFolder() { setenv("UBS_KERNEL_DIR", (source_folder() / "kernels").c_str(), 1); }
  ~KernelFolder() { unsetenv("UBS_KERNEL_DIR"); }
};

}  // namespace ubs::test
