// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/cuda_api.hpp"

namespace ubs::cuda {

void check(cudaError_t code, const char* call) {
  if (code == cudaSuccess) return;
  cudaGetLastError();  // clears an error that is not sticky, so that the next launch does not report it
  fail(code == cudaErrorMemoryAllocation ? ErrorKind::memory : ErrorKind::device, "{} failed with {}: {}",
       call, cudaGetErrorName(code), cudaGetErrorString(code));
}

EventHandle make_event(bool timed) {
  cudaEvent_t event = nullptr;
  check(cudaEventCreateWithFlags(&event, timed ? cudaEventDefault : cudaEventDisableTiming),
        "cudaEventCreateWithFlags");
  return EventHandle(event);
}

}  // namespace ubs::cuda
