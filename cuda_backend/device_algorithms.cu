// SPDX-License-Identifier: Apache-2.0
#include <thrust/iterator/transform_iterator.h>

#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include "cuda_backend/device_algorithms.hpp"

namespace ubs::cuda {
namespace {

// Converts to 64 bits, because CUB sums in the type of its input, which would wrap at 32 bits.
struct Widen {
  __host__ __device__ u64 operator()(u32 value) const { return value; }
};

}  // namespace

cudaError_t scan_counts(Workspace& workspace, const u32* tile_counts, u64* before, u32 count,
                        u32 bits, cudaStream_t stream) {
  return cub::DeviceScan::ExclusiveScan(workspace.data, workspace.bytes,
                                        thrust::make_transform_iterator(tile_counts, PackCounts{bits}), before,
                                        AddCounts{bits}, u64{0}, count, stream);
}

cudaError_t scan_exclusive(Workspace& workspace, const u32* in, u32* out, u32 count, cudaStream_t stream) {
  return cub::DeviceScan::ExclusiveSum(workspace.data, workspace.bytes, in, out, count, stream);
}

cudaError_t scan_inclusive(Workspace& workspace, const u32* in, u64* out, u32 count, cudaStream_t stream) {
  return cub::DeviceScan::InclusiveSum(workspace.data, workspace.bytes,
                                       thrust::make_transform_iterator(in, Widen{}), out, count, stream);
}

template <typename Key>
cudaError_t sort_pairs(Workspace& workspace, const Key* keys_in, Key* keys_out, const u32* values_in,
                       u32* values_out, u32 count, int first_bit, int last_bit, cudaStream_t stream) {
  return cub::DeviceRadixSort::SortPairs(workspace.data, workspace.bytes, keys_in, keys_out, values_in,
                                         values_out, count, first_bit, last_bit, stream);
}
template cudaError_t sort_pairs(Workspace&, const u16*, u16*, const u32*, u32*, u32, int, int, cudaStream_t);
template cudaError_t sort_pairs(Workspace&, const u32*, u32*, const u32*, u32*, u32, int, int, cudaStream_t);

}  // namespace ubs::cuda
