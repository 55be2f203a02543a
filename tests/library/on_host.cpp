// SPDX-License-Identifier: Apache-2.0
// Adds the CUDA back end on the host to the back ends of the library that is linked with this file.
#include "tests/cuda/cuda_on_host.hpp"

namespace {
[[maybe_unused]] const bool registered = (ubs::test::register_cuda_on_host(), true);
}
