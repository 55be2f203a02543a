// SPDX-License-Identifier: Apache-2.0
// Implements the memory and the streams of the CUDA runtime on the host, and the algorithms that CUB provides
// on a GPU.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "cuda_backend/device_algorithms.hpp"

namespace {

constexpr std::size_t kFence = 256, kMemoryBytes = std::size_t{2} << 30;
// Guard bytes are kFenceByte. New memory is filled with kPoison, which gives NaN or the largest index.
constexpr unsigned char kFenceByte = 0xa5, kPoison = 0xff;
std::map<void*, std::size_t> sizes;
std::set<cudaStream_t> streams;

bool late_by_environment(cudaStream_t) {
  static const char* const wanted = std::getenv("UBS_CUDA_ON_HOST_STREAMS");
  return wanted && std::strcmp(wanted, "late") == 0;
}

}  // namespace

namespace cuda_on_host {

Card card;

std::function<bool(cudaStream_t)> is_late = late_by_environment;

void run_until(cudaStream_t stream, std::size_t calls) {
  while (stream->done < calls) {
    const std::function<void()> call = std::move(stream->waiting.front());
    stream->waiting.pop_front();
    ++stream->done;
    call();
  }
}

cudaError_t enqueue(cudaStream_t stream, std::function<void()> run) {
  stream->waiting.push_back(std::move(run));
  if (!is_late(stream)) run_until(stream, stream->given());
  return cudaSuccess;
}

}  // namespace cuda_on_host

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

cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind,
                            cudaStream_t stream) {
  return cuda_on_host::enqueue(stream, [=] { std::memmove(to, from, bytes); });
}
cudaError_t cudaMemsetAsync(void* to, int value, std::size_t bytes, cudaStream_t stream) {
  return cuda_on_host::enqueue(stream, [=] { std::memset(to, value, bytes); });
}

cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned) {
  *stream = new CUstream_st;
  streams.insert(*stream);
  return cudaSuccess;
}
cudaError_t cudaStreamDestroy(cudaStream_t stream) {
  cuda_on_host::run_until(stream, stream->given());
  streams.erase(stream);
  return delete stream, cudaSuccess;
}
cudaError_t cudaStreamSynchronize(cudaStream_t stream) {
  return cuda_on_host::run_until(stream, stream->given()), cudaSuccess;
}

cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream) {
  *event = {std::chrono::steady_clock::now(), stream, stream->given()};
  return cudaSuccess;
}
cudaError_t cudaEventSynchronize(cudaEvent_t event) {
  if (streams.contains(event->stream)) cuda_on_host::run_until(event->stream, event->behind);
  return cudaSuccess;
}
cudaError_t cudaStreamWaitEvent(cudaStream_t stream, cudaEvent_t event, unsigned) {
  if (!event->stream) return cudaSuccess;
  return cuda_on_host::enqueue(
      stream, [on = event->stream, calls = event->behind] { cuda_on_host::run_until(on, calls); });
}

cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int) {
  const cuda_on_host::Card& card = cuda_on_host::card;
  *properties = {"CUDA on the host", card.capability / 10, card.capability % 10, 1, kMemoryBytes, 0, 1, 0};
  return card.properties;
}

cudaError_t cudaMemGetInfo(std::size_t* free, std::size_t* total) {
  *total = kMemoryBytes;
  *free = kMemoryBytes - cuda_on_host::card.used;
  return cudaSuccess;
}

namespace cuda_on_host {

namespace {

// Returns x rounded to a multiple of 2^dropped units in the last place. Denormal results become 0.
float coarse(float x, int dropped) {
  std::uint32_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  const std::uint32_t unit = 1u << dropped;
  bits = (bits + unit / 2) & ~(unit - 1);
  std::memcpy(&x, &bits, sizeof x);
  return std::fpclassify(x) == FP_SUBNORMAL ? 0.0f : x;
}

}  // namespace

float exp2_approx(float y) { return coarse(std::exp2(y), 2); }
float log2_approx(float x) {
  const float exact = std::log2(x);
  return x > 0.5f && x < 2 ? std::nearbyint(exact * 0x1p21f) * 0x1p-21f : coarse(exact, 2);
}
float recip_approx(float x) { return coarse(1 / x, 1); }

}  // namespace cuda_on_host

namespace ubs::cuda {
namespace {

// Runs `call` like an algorithm of CUB. A call without scratch memory only returns the size that is needed.
// The second call must pass scratch memory of this size; then `call` is enqueued on the stream.
template <typename Call>
cudaError_t algorithm(Workspace& workspace, cudaStream_t stream, const Call& call) {
  constexpr std::size_t kBytes = 64;
  if (!workspace.data) return workspace.bytes = kBytes, cudaSuccess;
  if (workspace.bytes < kBytes) std::abort();
  return cuda_on_host::enqueue(stream, [call, scratch = static_cast<unsigned char*>(workspace.data)] {
    std::fill_n(scratch, kBytes, kPoison);
    call();
  });
}

}  // namespace

cudaError_t scan_counts(Workspace& workspace, const u32* tile_counts, u64* before, u32 count, u32 bits,
                        cudaStream_t stream) {
  return algorithm(workspace, stream, [=] {
    const PackCounts counts{bits};
    const AddCounts add{bits};
    std::transform_exclusive_scan(tile_counts, tile_counts + count, before, u64{0}, add, counts);
  });
}

cudaError_t scan_exclusive(Workspace& workspace, const u32* in, u32* out, u32 count, cudaStream_t stream) {
  return algorithm(workspace, stream, [=] { std::exclusive_scan(in, in + count, out, 0u); });
}

cudaError_t scan_inclusive(Workspace& workspace, const u32* in, u64* out, u32 count, cudaStream_t stream) {
  return algorithm(workspace, stream,
                   [=] { std::inclusive_scan(in, in + count, out, std::plus<>(), u64{0}); });
}

template <typename Key>
cudaError_t sort_pairs(Workspace& workspace, const Key* keys_in, Key* keys_out, const u32* values_in,
                       u32* values_out, u32 count, int first_bit, int last_bit, cudaStream_t stream) {
  return algorithm(workspace, stream, [=] {
    const u32 mask = (last_bit >= 32 ? ~0u : (1u << last_bit) - 1u) & ~((1u << first_bit) - 1u);
    std::vector<u32> order(count);
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(),
                     [&](u32 a, u32 b) { return (keys_in[a] & mask) < (keys_in[b] & mask); });
    for (u32 i = 0; i < count; ++i) {
      keys_out[i] = keys_in[order[i]];
      values_out[i] = values_in[order[i]];
    }
  });
}
template cudaError_t sort_pairs(Workspace&, const u16*, u16*, const u32*, u32*, u32, int, int, cudaStream_t);
template cudaError_t sort_pairs(Workspace&, const u32*, u32*, const u32*, u32*, u32, int, int, cudaStream_t);

}  // namespace ubs::cuda
