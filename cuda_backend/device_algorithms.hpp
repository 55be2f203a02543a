// SPDX-License-Identifier: Apache-2.0
// Prefix sums and the radix sort of the CUDA back end, implemented with CUB. This interface keeps CUB out of
// other files, because CUB takes long to compile. All functions are deterministic and enqueue their work on
// the stream.
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

// Numbers of splats and tiles, packed into one value: the splats in the lower `bits` bits, the tiles above
// (see Lists::run() in cuda_lists.cpp). ToCounts packs those of one splat, and AddCounts adds those of two
// ranges. If the number of tiles overflows, it becomes the largest possible one, regardless of how the splats
// are divided into ranges.
struct ToCounts {
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

// before[i] = sum (AddCounts) of the packed counts (ToCounts) of the splats before i.
cudaError_t scan_counts(Workspace& workspace, const u32* tile_counts, u64* before, u32 count, u32 bits,
                        cudaStream_t stream);
// out[i] = in[0] + ... + in[i - 1], 32 bits.
cudaError_t scan_exclusive(Workspace& workspace, const u32* in, u32* out, u32 count, cudaStream_t stream);
// out[i] = in[0] + ... + in[i], 64 bits.
cudaError_t scan_inclusive(Workspace& workspace, const u32* in, u64* out, u32 count, cudaStream_t stream);
// Sorts in ascending order by the bits first_bit .. last_bit - 1 of the keys; the sort is stable. No array
// may overlap another.
cudaError_t sort_pairs(Workspace& workspace, const u32* keys_in, u32* keys_out, const u32* values_in,
                       u32* values_out, u32 count, int first_bit, int last_bit, cudaStream_t stream);

}  // namespace ubs::cuda
