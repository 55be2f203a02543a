// SPDX-License-Identifier: Apache-2.0
// The CUDA back end on the host, offered to the registry as one more back end.
#pragma once

namespace ubs::test {

// Its device is called "CUDA on the host".
void register_cuda_on_host();

}  // namespace ubs::test
