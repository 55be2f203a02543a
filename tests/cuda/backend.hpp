// SPDX-License-Identifier: Apache-2.0
// Offers the CUDA back end on the host to the registry as an additional back end.
#pragma once

namespace ubs::test {

// Its device is called "CUDA on the host".
void register_cuda_on_host();

}  // namespace ubs::test
