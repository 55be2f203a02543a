// SPDX-License-Identifier: Apache-2.0
#include "tests/cuda/cuda_on_host.hpp"

#include "cuda_backend/cuda_platform.hpp"
#include "host/device/registry.hpp"

namespace ubs::test {

void register_cuda_on_host() {
  register_backend({.name = "cuda", .list_devices = cuda::list_devices, .open_device = cuda::open_device});
}

}  // namespace ubs::test
