// SPDX-License-Identifier: Apache-2.0
// Error checks for calls of the CUDA runtime API, and handles that own its streams and events.
#pragma once

#include <cuda_runtime.h>

#include <memory>
#include <type_traits>

#include "host/base/error.hpp"

namespace ubs::cuda {

// Throws Error(memory) or Error(device) if `code` is an error. The message contains `call`, the name of the
// function that returned the code. Must not be used in destructors, because it throws.
void check(cudaError_t code, const char* call);

template <typename T, cudaError_t (*release)(T)>
struct Releaser {
  void operator()(T handle) const { release(handle); }
};
using StreamHandle =
    std::unique_ptr<std::remove_pointer_t<cudaStream_t>, Releaser<cudaStream_t, cudaStreamDestroy>>;
using EventHandle =
    std::unique_ptr<std::remove_pointer_t<cudaEvent_t>, Releaser<cudaEvent_t, cudaEventDestroy>>;

// Creates an event. Only timed events record the time at which they are reached.
EventHandle make_event(bool timed);

}  // namespace ubs::cuda
