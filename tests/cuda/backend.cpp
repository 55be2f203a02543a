// SPDX-License-Identifier: Apache-2.0
#include "tests/cuda/backend.hpp"

#include "cuda_backend/cuda_platform.hpp"
#include "host/device/registry.hpp"

namespace ubs::test {

void register_cuda_on_host() { register_backend({cuda::list_devices, cuda::open_device}); }

}  // namespace ubs::test
