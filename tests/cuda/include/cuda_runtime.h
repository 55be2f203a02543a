// SPDX-License-Identifier: Apache-2.0
// Implements the parts of the CUDA language and runtime that cuda_backend/ uses, so that its .cu and .cpp
// files can be compiled unchanged with a C++ compiler and run without a GPU. Only tests use this file. Every
// thread of a block is a fibre; barriers and warp operations switch between fibres (tests/cuda/fibres.cpp).
// New device memory is filled with NaN. A write into the guard bytes around a buffer, or a barrier that not
// all threads reach, ends the program with a message.
#pragma once

#include <math.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <deque>
#include <functional>
#include <memory>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

// ---- Language ----

#define __CUDACC__ 1
#define UBS_CUDA_ON_HOST 1
#define __global__
#define __device__
#define __host__
#define __CUDA_ARCH_LIST__ 800, 900
#define __constant__
#define __shared__ static  // sufficient, because only one block runs at a time
#define __forceinline__ inline __attribute__((always_inline))
#define __launch_bounds__(...)

struct uint2 {
  unsigned x, y;
};
struct uint3 {
  unsigned x, y, z;
};
struct float2 {
  float x, y;
};
struct alignas(16) float4 {
  float x, y, z, w;
};
struct dim3 {
  unsigned x = 1, y = 1, z = 1;
  dim3(unsigned x_ = 1, unsigned y_ = 1, unsigned z_ = 1) : x(x_), y(y_), z(z_) {}
};
inline float2 make_float2(float x, float y) { return {x, y}; }
inline float4 make_float4(float x, float y, float z, float w) { return {x, y, z, w}; }

namespace cuda_on_host {

extern dim3 grid_size, block_size;
extern uint3 block_position;
const uint3& thread_position();

void barrier();
// Passes `value` to the warp and returns the value that lane `source` passed. All 32 lanes must take part.
std::uint32_t exchange(std::uint32_t value, unsigned mask, unsigned source);
// Returns the lane of the thread in its warp.
unsigned lane();
// Returns a word in which bit i is the value that lane i passed. All 32 lanes must take part.
unsigned ballot(unsigned mask, bool value);

// The approximate instructions, with the largest errors that PTX allows. The relative error is 2^-22 for exp2
// and log2, and 2^-23 for the reciprocal. For log2 of numbers between 1/2 and 2, the absolute error is 2^-22.
// Denormal results are 0.
float exp2_approx(float y);
float log2_approx(float x);
float recip_approx(float x);

void run(dim3 grid, dim3 block, const std::function<void()>& kernel);

}  // namespace cuda_on_host

#define gridDim (cuda_on_host::grid_size)
#define blockDim (cuda_on_host::block_size)
#define blockIdx (cuda_on_host::block_position)
#define threadIdx (cuda_on_host::thread_position())

inline void __syncthreads() { cuda_on_host::barrier(); }
inline unsigned __ballot_sync(unsigned mask, int value) { return cuda_on_host::ballot(mask, value != 0); }
inline int __any_sync(unsigned mask, int value) { return cuda_on_host::ballot(mask, value != 0) != 0; }
inline float __shfl_sync(unsigned mask, float value, int source, int width = 32) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  const unsigned first = cuda_on_host::lane() / static_cast<unsigned>(width) * static_cast<unsigned>(width);
  bits = cuda_on_host::exchange(bits, mask,
                                first + static_cast<unsigned>(source) % static_cast<unsigned>(width));
  std::memcpy(&value, &bits, sizeof bits);
  return value;
}
inline float __shfl_xor_sync(unsigned mask, float value, int distance) {
  return __shfl_sync(mask, value, static_cast<int>(cuda_on_host::lane() ^ static_cast<unsigned>(distance)));
}

inline float __shfl_up_sync(unsigned mask, float value, int distance) {
  const int here = static_cast<int>(cuda_on_host::lane());
  return __shfl_sync(mask, value, here < distance ? here : here - distance);
}
inline void __syncwarp(unsigned mask = 0xffffffffu) { cuda_on_host::ballot(mask, true); }

inline int __ffs(int value) { return __builtin_ffs(value); }
inline int __popc(unsigned value) { return __builtin_popcount(value); }
inline unsigned __umulhi(unsigned a, unsigned b) {
  return static_cast<unsigned>((static_cast<unsigned long long>(a) * b) >> 32);
}
inline unsigned long long __umul64hi(unsigned long long a, unsigned long long b) {
  __extension__ using Wide = unsigned __int128;
  return static_cast<unsigned long long>((static_cast<Wide>(a) * b) >> 64);
}
inline float __fadd_rn(float a, float b) { return a + b; }
inline float __fsub_rn(float a, float b) { return a - b; }
inline unsigned __float_as_uint(float value) {
  unsigned bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}
inline float __uint_as_float(unsigned bits) {
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}
inline unsigned atomicMax(unsigned* at, unsigned value) {
  const unsigned before = *at;
  *at = before < value ? value : before;
  return before;
}
inline unsigned atomicOr(unsigned* at, unsigned bits) {
  const unsigned before = *at;
  *at |= bits;
  return before;
}
inline unsigned atomicAdd(unsigned* at, unsigned value) {
  const unsigned before = *at;
  *at += value;
  return before;
}
inline float atomicAdd(float* at, float value) {
  const float before = *at;
  *at += value;
  return before;
}

// ---- Runtime ----

enum cudaError_t {
  cudaSuccess = 0,
  cudaErrorInvalidValue = 1,
  cudaErrorMemoryAllocation = 2,
  cudaErrorInsufficientDriver = 35,
  cudaErrorNoDevice = 100,
  cudaErrorNoKernelImageForDevice = 209
};
enum cudaMemcpyKind { cudaMemcpyHostToDevice, cudaMemcpyDeviceToHost, cudaMemcpyDeviceToDevice };
constexpr unsigned cudaStreamNonBlocking = 1, cudaEventDefault = 0, cudaEventDisableTiming = 2;
struct CUstream_st {
  std::deque<std::function<void()>> waiting;  // calls of a late stream that have not run yet
  std::size_t done = 0;                       // number of calls that have run
  std::size_t given() const { return done + waiting.size(); }
};
struct CUevent_st {
  std::chrono::steady_clock::time_point time;
  CUstream_st* stream = nullptr;  // the stream on which the event was recorded
  std::size_t behind = 0;         // number of calls of the stream before the event
};
using cudaStream_t = CUstream_st*;
using cudaEvent_t = CUevent_st*;
struct cudaDeviceProp {
  char name[64];
  int major, minor, multiProcessorCount;
  std::size_t totalGlobalMem;
  int pciDomainID, pciBusID, pciDeviceID;
};

namespace cuda_on_host {

// Returns whether a stream is late. A late stream runs its work as late as CUDA allows, that is, when the
// host or another stream waits for this work. Other streams run their work immediately. By default no stream
// is late. With UBS_CUDA_ON_HOST_STREAMS=late all streams are.
extern std::function<bool(cudaStream_t)> is_late;
// Runs the work of a stream until `calls` of its calls have run.
void run_until(cudaStream_t stream, std::size_t calls);
// Runs the call immediately, or stores it if the stream is late.
cudaError_t enqueue(cudaStream_t stream, std::function<void()> run);
// The properties that the runtime reports for the driver and its only GPU. Tests change them.
struct Card {
  int driver = 0, runtime = 0, capability = 90;
  // The results of cudaGetDeviceCount(), cudaGetDeviceProperties() and cudaFuncGetAttributes().
  cudaError_t count = cudaSuccess, properties = cudaSuccess, code = cudaSuccess;
  std::size_t used = 0;  // memory that other programs use [bytes]
};
extern Card card;

}  // namespace cuda_on_host

cudaError_t cudaMalloc(void** memory, std::size_t bytes);
cudaError_t cudaFree(void* memory);
enum cudaMemoryType { cudaMemoryTypeHost = 1, cudaMemoryTypeDevice = 2 };
struct cudaPointerAttributes {
  cudaMemoryType type;
  int device;
};
inline cudaError_t cudaPointerGetAttributes(cudaPointerAttributes* attributes, const void*) {
  return *attributes = {cudaMemoryTypeHost, 0}, cudaSuccess;
}
cudaError_t cudaMallocHost(void** memory, std::size_t bytes);
cudaError_t cudaFreeHost(void* memory);
cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int ordinal);
cudaError_t cudaMemGetInfo(std::size_t* free, std::size_t* total);
inline const char* cudaGetErrorName(cudaError_t) { return "cudaError"; }
inline const char* cudaGetErrorString(cudaError_t) { return "error on the host"; }
inline cudaError_t cudaGetLastError() { return cudaSuccess; }
inline cudaError_t cudaSetDevice(int) { return cudaSuccess; }
inline cudaError_t cudaGetDeviceCount(int* count) { return *count = 1, cuda_on_host::card.count; }
inline cudaError_t cudaDriverGetVersion(int* version) {
  return *version = cuda_on_host::card.driver, cudaSuccess;
}
inline cudaError_t cudaRuntimeGetVersion(int* version) {
  return *version = cuda_on_host::card.runtime, cudaSuccess;
}
struct cudaFuncAttributes {};
template <typename Function>
cudaError_t cudaFuncGetAttributes(cudaFuncAttributes*, Function) {
  return cuda_on_host::card.code;
}
cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned);
cudaError_t cudaStreamDestroy(cudaStream_t stream);
cudaError_t cudaStreamSynchronize(cudaStream_t stream);
inline cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned) {
  return *event = new CUevent_st, cudaSuccess;
}
inline cudaError_t cudaEventDestroy(cudaEvent_t event) { return delete event, cudaSuccess; }
cudaError_t cudaEventSynchronize(cudaEvent_t event);
cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream);
cudaError_t cudaStreamWaitEvent(cudaStream_t stream, cudaEvent_t event, unsigned);
inline cudaError_t cudaEventElapsedTime(float* ms, cudaEvent_t begin, cudaEvent_t end) {
  return *ms = std::chrono::duration<float, std::milli>(end->time - begin->time).count(), cudaSuccess;
}
cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind,
                            cudaStream_t stream);
cudaError_t cudaMemsetAsync(void* to, int value, std::size_t bytes, cudaStream_t stream);

// Returns a function that calls the kernel with the values that the arguments have now.
template <typename... Parameters>
std::function<void()> ubs_bind(void (*kernel)(Parameters...), void** arguments) {
  return [&]<std::size_t... i>(std::index_sequence<i...>) {
    return std::function<void()>([kernel, values = std::tuple<Parameters...>(*static_cast<Parameters*>(
                                              arguments[i])...)] { std::apply(kernel, values); });
  }
  (std::index_sequence_for<Parameters...>{});
}
template <typename... Parameters>
cudaError_t cudaLaunchKernel(void (*kernel)(Parameters...), dim3 grid, dim3 block, void** arguments,
                             std::size_t, cudaStream_t stream) {
  return cuda_on_host::enqueue(
      stream, [grid, block, call = ubs_bind(kernel, arguments)] { cuda_on_host::run(grid, block, call); });
}
