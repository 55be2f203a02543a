// SPDX-License-Identifier: Apache-2.0
// These functions execute single instructions of the GPU, which compute approximations of 2^y, log2(x) and
// 1/x. CUDA C++ has no functions for these instructions, or has them only in headers that NVRTC does not
// include. If UBS_CUDA_ON_HOST is defined, the instructions are emulated for the build that runs on the host
// (tests/cuda).

#ifdef UBS_CUDA_ON_HOST
__device__ __forceinline__ float native_exp2(float y) { return cuda_on_host::exp2_approx(y); }
__device__ __forceinline__ float native_log2(float x) { return cuda_on_host::log2_approx(x); }
__device__ __forceinline__ float native_recip(float x) { return cuda_on_host::recip_approx(x); }
#else
__device__ __forceinline__ float native_exp2(float y) {
  float result;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(result) : "f"(y));
  return result;
}
__device__ __forceinline__ float native_log2(float x) {
  float result;
  asm("lg2.approx.ftz.f32 %0, %1;" : "=f"(result) : "f"(x));
  return result;
}
__device__ __forceinline__ float native_recip(float x) {
  float result;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(result) : "f"(x));
  return result;
}
#endif
