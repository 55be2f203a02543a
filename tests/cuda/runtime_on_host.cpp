// SPDX-License-Identifier: Apache-2.0
// Memory of the CUDA runtime on the host, and the algorithms that CUB provides on a GPU.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numeric>
#include <vector>

#include "cuda_backend/device_algorithms.hpp"

namespace {

constexpr std::size_t kFence = 256, kMemoryBytes = std::size_t{2} << 30;
constexpr unsigned char kFenceByte = 0xa5, kPoison = 0xff;  // poison: NaN, or the largest index
std::map<void*, std::size_t> sizes;

}  // namespace

cudaError_t cudaMalloc(void** memory, std::size_t bytes) {
  if (bytes > kMemoryBytes) return cudaErrorMemoryAllocation;
  auto* start =
      static_cast<unsigned char*>(std::aligned_alloc(kFence, (bytes + 3 * kFence - 1) / kFence * kFence));
  if (!start) return cudaErrorMemoryAllocation;
  std::fill_n(start, kFence, kFenceByte);
  std::fill_n(start + kFence, bytes, kPoison);
  std::fill_n(start + kFence + bytes, kFence, kFenceByte);
  sizes[start + kFence] = bytes;
  *memory = start + kFence;
  return cudaSuccess;
}

cudaError_t cudaFree(void* memory) {
  const auto found = sizes.find(memory);
  if (found == sizes.end()) std::abort();
  auto* start = static_cast<unsigned char*>(memory);
  const auto intact = [](const unsigned char* fence) {
    return std::all_of(fence, fence + kFence, [](unsigned char byte) { return byte == kFenceByte; });
  };
  if (!intact(start - kFence) || !intact(start + found->second)) {
    std::fprintf(stderr, "CUDA on the host: write outside of a buffer of %zu bytes\n", found->second);
    std::abort();
  }
  sizes.erase(found);
  std::free(start - kFence);
  return cudaSuccess;
}

cudaError_t cudaMallocHost(void** memory, std::size_t bytes) {
  *memory = std::malloc(bytes);
  return *memory ? cudaSuccess : cudaErrorMemoryAllocation;
}
cudaError_t cudaFreeHost(void* memory) { return std::free(memory), cudaSuccess; }

cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int) {
  *properties = {"CUDA on the host", 9, 0, 1, kMemoryBytes, 0, 1, 0, 8 << 20};
  return cudaSuccess;
}

namespace cuda_on_host {

// The host's instructions for halves; nearest, ties to even, as on the device.
unsigned half_from_float(float x) {
  const _Float16 half = static_cast<_Float16>(x);
  std::uint16_t bits;
  std::memcpy(&bits, &half, sizeof bits);
  return bits;
}
float float_from_half(unsigned bits) {
  const auto low = static_cast<std::uint16_t>(bits);
  _Float16 half;
  std::memcpy(&half, &low, sizeof half);
  return static_cast<float>(half);
}

}  // namespace cuda_on_host

namespace ubs::cuda {
namespace {

// The protocol of CUB: a call without memory asks for the size; the size must be there in the second.
bool asks_for_size(Workspace& workspace) {
  constexpr std::size_t kBytes = 64;
  if (!workspace.data) return workspace.bytes = kBytes, true;
  if (workspace.bytes < kBytes) std::abort();
  std::fill_n(static_cast<unsigned char*>(workspace.data), kBytes, kPoison);
  return false;
}

}  // namespace

cudaError_t scan_counts(Workspace& workspace, const u32* tile_counts, SplatCounts* before, u32 count,
                        cudaStream_t) {
  if (asks_for_size(workspace)) return cudaSuccess;
  SplatCounts sum{0, 0};
  for (u32 i = 0; i < count; ++i) {
    before[i] = sum;
    sum.tiles += tile_counts[i];
    sum.drawn += tile_counts[i] > 0;
  }
  return cudaSuccess;
}

cudaError_t scan_exclusive(Workspace& workspace, const u32* in, u32* out, u32 count, cudaStream_t) {
  if (asks_for_size(workspace)) return cudaSuccess;
  std::exclusive_scan(in, in + count, out, 0u);
  return cudaSuccess;
}

cudaError_t scan_inclusive(Workspace& workspace, const u32* in, u64* out, u32 count, cudaStream_t) {
  if (asks_for_size(workspace)) return cudaSuccess;
  std::inclusive_scan(in, in + count, out, std::plus<>(), u64{0});
  return cudaSuccess;
}

cudaError_t sort_pairs(Workspace& workspace, const u32* keys_in, u32* keys_out, const u32* values_in,
                       u32* values_out, u32 count, int first_bit, int last_bit, cudaStream_t) {
  if (asks_for_size(workspace)) return cudaSuccess;
  const u32 mask = (last_bit >= 32 ? ~0u : (1u << last_bit) - 1u) & ~((1u << first_bit) - 1u);
  std::vector<u32> order(count);
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](u32 a, u32 b) { return (keys_in[a] & mask) < (keys_in[b] & mask); });
  for (u32 i = 0; i < count; ++i) {
    keys_out[i] = keys_in[order[i]];
    values_out[i] = values_in[order[i]];
  }
  return cudaSuccess;
}

}  // namespace ubs::cuda
