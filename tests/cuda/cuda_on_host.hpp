// SPDX-License-Identifier: Apache-2.0
// Registers the CUDA back end that runs on the host (README.md in this folder) as an additional back end.
#pragma once

namespace ubs::test {

// The device of the back end is called "CUDA on the host".
void register_cuda_on_host();

}  // namespace ubs::test
