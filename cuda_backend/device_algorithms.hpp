// SPDX-License-Identifier: Apache-2.0
// Prefix sums and the radix sort of the CUDA back end, which are CUB's: one small door, so that only one file
// pays for compiling them. All are deterministic and enqueued on the stream.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

#include "cuda_backend/cuda_kernels.hpp"

namespace ubs::cuda {

// Scratch memory of a call. With data == nullptr a call only sets `bytes` to what it needs.
struct Workspace {
  void* data = nullptr;
  std::size_t bytes = 0;
};

// Splats and tiles of one splat, and of two ranges, packed (count_bits() in kernels.hpp). Tiles that do not
// fit any more are as many as fit, wherever the ranges are cut.
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

// before[i] = ToCounts and AddCounts of the splats before i.
cudaError_t scan_counts(Workspace& workspace, const u32* tile_counts, u64* before, u32 count, u32 bits,
                        cudaStream_t stream);
// out[i] = in[0] + ... + in[i - 1], 32 bits.
cudaError_t scan_exclusive(Workspace& workspace, const u32* in, u32* out, u32 count, cudaStream_t stream);
// out[i] = in[0] + ... + in[i], 64 bits.
cudaError_t scan_inclusive(Workspace& workspace, const u32* in, u64* out, u32 count, cudaStream_t stream);
// Stable, ascending by the bits first_bit .. last_bit - 1 of the keys. No array may overlap another.
cudaError_t sort_pairs(Workspace& workspace, const u32* keys_in, u32* keys_out, const u32* values_in,
                       u32* values_out, u32 count, int first_bit, int last_bit, cudaStream_t stream);

}  // namespace ubs::cuda
