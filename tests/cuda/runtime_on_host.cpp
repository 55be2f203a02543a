// SPDX-License-Identifier: Apache-2.0
// Memory, streams and graphs of the CUDA runtime on the host, and the algorithms that CUB provides on a GPU.
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
constexpr unsigned char kFenceByte = 0xa5, kPoison = 0xff;  // poison: NaN, or the largest index
std::map<void*, std::size_t> sizes;
std::set<cudaStream_t> streams;
cudaStream_t recording = nullptr;  // at most one stream at a time

bool late_by_environment(cudaStream_t) {
  static const char* const wanted = std::getenv("UBS_CUDA_ON_HOST_STREAMS");
  return wanted && std::strcmp(wanted, "late") == 0;
}

constexpr char kCopy = 0, kFill = 0;  // their addresses are what nodes are

}  // namespace

namespace cuda_on_host {

cudaError_t refused_graph = cudaSuccess;
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

cudaError_t give(cudaStream_t stream, const void* what, std::function<void()> run) {
  if (!stream->recorded) {
    stream->waiting.push_back(std::move(run));
    if (!is_late(stream)) run_until(stream, stream->given());
    return cudaSuccess;
  }
  if (stream->spoilt) return cudaErrorStreamCaptureInvalidated;
  stream->recorded->nodes.push_back({what, std::move(run)});
  return cudaSuccess;
}

cudaError_t unrecorded() {
  if (!recording) return cudaSuccess;
  recording->spoilt = true;
  return cudaErrorStreamCaptureUnsupported;
}

}  // namespace cuda_on_host

cudaError_t cudaMalloc(void** memory, std::size_t bytes) {
  if (const cudaError_t code = cuda_on_host::unrecorded(); code != cudaSuccess) return code;
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
  if (const cudaError_t code = cuda_on_host::unrecorded(); code != cudaSuccess) return code;
  for (const cudaStream_t stream : streams) cuda_on_host::run_until(stream, stream->given());
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
  if (const cudaError_t code = cuda_on_host::unrecorded(); code != cudaSuccess) return code;
  *memory = std::malloc(bytes);
  return *memory ? cudaSuccess : cudaErrorMemoryAllocation;
}
cudaError_t cudaFreeHost(void* memory) { return std::free(memory), cudaSuccess; }

cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind,
                            cudaStream_t stream) {
  return cuda_on_host::give(stream, &kCopy, [=] { std::memmove(to, from, bytes); });
}
cudaError_t cudaMemsetAsync(void* to, int value, std::size_t bytes, cudaStream_t stream) {
  return cuda_on_host::give(stream, &kFill, [=] { std::memset(to, value, bytes); });
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
  if (const cudaError_t code = cuda_on_host::unrecorded(); code != cudaSuccess) return code;
  return cuda_on_host::run_until(stream, stream->given()), cudaSuccess;
}

cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream) {
  *event = {std::chrono::steady_clock::now(), stream, stream->given()};
  return cuda_on_host::unrecorded();
}
cudaError_t cudaEventSynchronize(cudaEvent_t event) {
  if (const cudaError_t code = cuda_on_host::unrecorded(); code != cudaSuccess) return code;
  if (streams.contains(event->stream)) cuda_on_host::run_until(event->stream, event->behind);
  return cudaSuccess;
}
cudaError_t cudaStreamWaitEvent(cudaStream_t stream, cudaEvent_t event, unsigned) {
  if (const cudaError_t code = cuda_on_host::unrecorded(); code != cudaSuccess) return code;
  if (!event->stream) return cudaSuccess;
  return cuda_on_host::give(
      stream, event, [on = event->stream, calls = event->behind] { cuda_on_host::run_until(on, calls); });
}

cudaError_t cudaStreamBeginCapture(cudaStream_t stream, cudaStreamCaptureMode) {
  if (recording) return cudaErrorInvalidValue;
  recording = stream;
  stream->recorded = std::make_unique<CUgraph_st>();
  stream->spoilt = false;
  return cudaSuccess;
}

cudaError_t cudaStreamEndCapture(cudaStream_t stream, cudaGraph_t* graph) {
  recording = nullptr;
  *graph = stream->spoilt ? nullptr : stream->recorded.release();
  stream->recorded.reset();
  return *graph ? cudaSuccess : cudaErrorStreamCaptureInvalidated;
}

cudaError_t cudaGraphGetNodes(cudaGraph_t graph, cudaGraphNode_t*, std::size_t* count) {
  return *count = graph->nodes.size(), cudaSuccess;
}

cudaError_t cudaGraphInstantiate(cudaGraphExec_t* executable, cudaGraph_t graph, unsigned long long) {
  if (const cudaError_t refused = std::exchange(cuda_on_host::refused_graph, cudaSuccess);
      refused != cudaSuccess)
    return refused;
  return *executable = new CUgraphExec_st{*graph}, cudaSuccess;
}

// Stricter than CUDA, where a kernel may become another one.
cudaError_t cudaGraphExecUpdate(cudaGraphExec_t executable, cudaGraph_t graph,
                                cudaGraphExecUpdateResultInfo*) {
  const auto same = [](const CUgraph_st::Node& a, const CUgraph_st::Node& b) { return a.what == b.what; };
  const auto &before = executable->graph.nodes, &now = graph->nodes;
  if (!std::equal(before.begin(), before.end(), now.begin(), now.end(), same))
    return cudaErrorGraphExecUpdateFailure;
  executable->graph = *graph;
  return cudaSuccess;
}

cudaError_t cudaGraphLaunch(cudaGraphExec_t executable, cudaStream_t stream) {
  return cuda_on_host::give(stream, executable, [nodes = executable->graph.nodes] {
    for (const CUgraph_st::Node& node : nodes) node.run();
  });
}

cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int) {
  const cuda_on_host::Card& card = cuda_on_host::card;
  *properties = {
      "CUDA on the host", card.capability / 10, card.capability % 10, 1, kMemoryBytes, 0, 1, 0, 8 << 20};
  return card.properties;
}

namespace cuda_on_host {

namespace {

// To the nearest multiple of 2^dropped units of its last place.
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

// The protocol of CUB: a call without memory asks for the size; the size must be there in the second, which
// runs as the stream has it.
template <typename Call>
cudaError_t algorithm(Workspace& workspace, cudaStream_t stream, const void* what, const Call& call) {
  constexpr std::size_t kBytes = 64;
  if (!workspace.data) return workspace.bytes = kBytes, cudaSuccess;
  if (workspace.bytes < kBytes) std::abort();
  return cuda_on_host::give(stream, what, [call, scratch = static_cast<unsigned char*>(workspace.data)] {
    std::fill_n(scratch, kBytes, kPoison);
    call();
  });
}

template <typename Function>
const void* address(Function* function) {
  return reinterpret_cast<const void*>(function);
}

}  // namespace

cudaError_t scan_counts(Workspace& workspace, const u32* tile_counts, u64* before, u32 count, u32 bits,
                        cudaStream_t stream) {
  return algorithm(workspace, stream, address(scan_counts), [=] {
    const ToCounts counts{bits};
    const AddCounts add{bits};
    std::transform_exclusive_scan(tile_counts, tile_counts + count, before, u64{0}, add, counts);
  });
}

cudaError_t scan_exclusive(Workspace& workspace, const u32* in, u32* out, u32 count, cudaStream_t stream) {
  return algorithm(workspace, stream, address(scan_exclusive),
                   [=] { std::exclusive_scan(in, in + count, out, 0u); });
}

cudaError_t scan_inclusive(Workspace& workspace, const u32* in, u64* out, u32 count, cudaStream_t stream) {
  return algorithm(workspace, stream, address(scan_inclusive),
                   [=] { std::inclusive_scan(in, in + count, out, std::plus<>(), u64{0}); });
}

cudaError_t sort_pairs(Workspace& workspace, const u32* keys_in, u32* keys_out, const u32* values_in,
                       u32* values_out, u32 count, int first_bit, int last_bit, cudaStream_t stream) {
  return algorithm(workspace, stream, address(sort_pairs), [=] {
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

}  // namespace ubs::cuda
