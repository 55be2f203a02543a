// SPDX-License-Identifier: Apache-2.0
// Draws the sources of relocation and growth (method.md 4.3) from the prefix sum of integer weights. Copies
// are counted with integer atomics, whose result does not depend on the order.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"

// The splat whose share [prefix[i], prefix[i + 1]) holds `ticket`; weight 0 is an empty share.
__device__ __forceinline__ u32 find_share(const u64* prefix, u32 count, u64 ticket) {
  u32 low = 0, high = count;  // prefix[low] <= ticket < prefix[high]
  while (high - low > 1) {
    const u32 middle = low + (high - low) / 2;
    if (prefix[middle] <= ticket)
      low = middle;
    else
      high = middle;
  }
  return low;
}

// 64 random bits times n, high word: uniform on 0 .. n - 1 but for a relative n / 2^64.
__device__ __forceinline__ u64 draw_below(RandomWords words, u64 n) {
  return __umul64hi(static_cast<u64>(words.x) << 32 | words.y, n);
}

// Slot i draws a source if its weight is 0 (relocation, slots = count, `weights` given) or always
// (growth, `weights` null). totals[0] counts the slots that got one.
__global__ void mcmc_draw(const u64* prefix, const u32* weights, u32 count, u32 slots, u32 purpose, u32 seed0,
                          u32 seed1, u32 iteration0, u32 iteration1, u32* sources, u32* copies, u32* totals) {
  const u32 i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i >= slots) return;
  const u64 total = prefix[count];
  sources[i] = UBS_NO_SOURCE;
  if (weights != nullptr && (weights[i] != 0 || total == 0)) return;
  const RandomWords words = random_words(seed0, seed1, iteration0, iteration1, purpose, i);
  // Growth must fill its slots even if every opacity is zero or NaN: all splats are then alike.
  const u32 source = total > 0 ? find_share(prefix, count, draw_below(words, total))
                               : static_cast<u32>(draw_below(words, count));
  sources[i] = source;
  atomicAdd(copies + source, 1u);
  atomicAdd(totals, 1u);
}

}  // namespace

McmcKernels mcmc_kernels() { return {mcmc_draw}; }

}  // namespace ubs::cuda
