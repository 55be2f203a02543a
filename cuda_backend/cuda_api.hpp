// SPDX-License-Identifier: Apache-2.0
// Error checks of the CUDA runtime API that report the failed call, and owning handles.
#pragma once

#include <cuda_runtime.h>

#include <memory>
#include <type_traits>

#include "host/base/error.hpp"

namespace ubs::cuda {

// Throws Error(memory) or Error(device) with the name of the call. Must not be used in destructors.
void check(cudaError_t code, const char* call);

template <typename T, cudaError_t (*release)(T)>
struct Releaser {
  void operator()(T handle) const { release(handle); }
};
using StreamHandle =
    std::unique_ptr<std::remove_pointer_t<cudaStream_t>, Releaser<cudaStream_t, cudaStreamDestroy>>;
using EventHandle =
    std::unique_ptr<std::remove_pointer_t<cudaEvent_t>, Releaser<cudaEvent_t, cudaEventDestroy>>;

EventHandle make_event(bool timed);

}  // namespace ubs::cuda
