// SPDX-License-Identifier: Apache-2.0
// Makes the CUDA back end on the host a back end of the library that this is linked into.
#include "tests/cuda/backend.hpp"

namespace {
[[maybe_unused]] const bool registered = (ubs::test::register_cuda_on_host(), true);
}
