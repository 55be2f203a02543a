// SPDX-License-Identifier: Apache-2.0
// Declares the prefix sums and the radix sort of the CUDA back end, which are implemented with CUB. This
// interface keeps CUB out of other files, because compiling CUB takes a long time. All functions are
// deterministic and enqueue their work on `stream`.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

#include "cuda_backend/cuda_kernels.hpp"

namespace ubs::cuda {

// Scratch memory of a call. A call with data == nullptr only sets `bytes` to the size that it needs.
struct Workspace {
  void* data = nullptr;
  std::size_t bytes = 0;
};

// PackCounts and AddCounts are the operators of a prefix sum that counts visible splats and their tiles at
// the same time (Lists::run() in cuda_lists.cpp). A packed value contains the number of visible splats in its
// lower `bits` bits and the number of tiles in the remaining upper bits. PackCounts returns the packed value
// of one splat from its number of tiles, and AddCounts adds the packed values of two ranges of splats. If the
// sum of the tiles overflows, it becomes the largest number that fits, regardless of how the splats are
// divided into ranges.
struct PackCounts {
  u32 bits;
  __host__ __device__ u64 operator()(u32 tiles) const {
    return (static_cast<u64>(tiles) << bits) + (tiles > 0 ? 1 : 0);
  }
};
struct AddCounts {
  u32 bits;
  __host__ __device__ u64 operator()(u64 a, u64 b) const {
    const u64 sum = a + b;
    return sum >= a ? sum : sum | ~0ull << bits;
  }
};

// Computes before[i], the sum (AddCounts) of the packed counts (PackCounts) of the splats before splat i.
cudaError_t scan_counts(Workspace& workspace, const u32* tile_counts, u64* before, u32 count, u32 bits,
                        cudaStream_t stream);
// Computes out[i] = in[0] + ... + in[i - 1] in 32 bits.
cudaError_t scan_exclusive(Workspace& workspace, const u32* in, u32* out, u32 count, cudaStream_t stream);
// Computes out[i] = in[0] + ... + in[i] in 64 bits.
cudaError_t scan_inclusive(Workspace& workspace, const u32* in, u64* out, u32 count, cudaStream_t stream);
// Sorts keys with their values in ascending order of the bits first_bit to last_bit - 1 of the keys. The sort
// is stable. No array may overlap another. `Key` is u16 or u32.
template <typename Key>
cudaError_t sort_pairs(Workspace& workspace, const Key* keys_in, Key* keys_out, const u32* values_in,
                       u32* values_out, u32 count, int first_bit, int last_bit, cudaStream_t stream);

}  // namespace ubs::cuda
