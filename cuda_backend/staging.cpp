// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/staging.hpp"

#include <algorithm>
#include <cstring>

namespace ubs::cuda {

PinnedMemory pinned_memory(std::size_t bytes) {
  void* memory = nullptr;
  check(cudaMallocHost(&memory, bytes), "cudaMallocHost");
  return PinnedMemory(static_cast<std::byte*>(memory));
}

Staging::Staging() {
  for (EventHandle& event : finished_) event = make_event(false);
  memory_ = pinned_memory(kSlots * kSlotBytes);
}

std::size_t Staging::take() {
  const std::size_t index = next_;
  next_ = (next_ + 1) % kSlots;
  check(cudaEventSynchronize(finished_[index].get()), "cudaEventSynchronize");
  return index;
}

void Staging::upload(void* to, std::span<const std::byte> from, cudaStream_t stream) {
  auto* target = static_cast<std::byte*>(to);
  for (std::size_t at = 0; at < from.size(); at += kSlotBytes) {
    const std::size_t bytes = std::min(kSlotBytes, from.size() - at), index = take();
    std::memcpy(slot(index), from.data() + at, bytes);
    check(cudaMemcpyAsync(target + at, slot(index), bytes, cudaMemcpyHostToDevice, stream),
          "cudaMemcpyAsync");
    check(cudaEventRecord(finished_[index].get(), stream), "cudaEventRecord");
  }
}

void Staging::download(std::span<std::byte> to, const void* from, cudaStream_t stream) {
  if (to.size() > kSlotBytes) {
    check(cudaMemcpyAsync(to.data(), from, to.size(), cudaMemcpyDeviceToHost, stream), "cudaMemcpyAsync");
    check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
    return;
  }
  const std::size_t index = take();
  check(cudaMemcpyAsync(slot(index), from, to.size(), cudaMemcpyDeviceToHost, stream), "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  std::memcpy(to.data(), slot(index), to.size());
}

ReadBlocks::Block ReadBlocks::take() {
  if (!free_.empty()) {
    Block block = std::move(free_.back());
    free_.pop_back();
    return block;
  }
  return {pinned_memory(kBytes), make_event(false)};
}

CudaRead::CudaRead(ReadBlocks& blocks, const void* from, std::size_t bytes, cudaStream_t stream)
    : blocks_(blocks), bytes_(bytes) {
  if (bytes > ReadBlocks::kBytes)
    fail(ErrorKind::internal, "a deferred read of {} bytes is not supported", bytes);
  block_ = blocks_.take();
  check(cudaMemcpyAsync(block_.memory.get(), from, bytes, cudaMemcpyDeviceToHost, stream), "cudaMemcpyAsync");
}

CudaRead::~CudaRead() {
  cudaEventSynchronize(block_.arrived.get());
  blocks_.give_back(std::move(block_));
}

std::span<const std::byte> CudaRead::wait() {
  check(cudaEventSynchronize(block_.arrived.get()), "cudaEventSynchronize");
  return {block_.memory.get(), bytes_};
}

void UploadRing::upload(void* to, std::span<const std::byte> from, cudaStream_t stream) {
  Slot& slot = slots_[next_];
  next_ = (next_ + 1) % slots_.size();
  if (slot.finished) check(cudaEventSynchronize(slot.finished.get()), "cudaEventSynchronize");
  if (!slot.finished) slot.finished = make_event(false);
  if (slot.bytes < from.size()) {
    slot.memory.reset();
    slot.bytes = 0;
    slot.memory = pinned_memory(from.size());
    slot.bytes = from.size();
  }
  std::memcpy(slot.memory.get(), from.data(), from.size());
  check(cudaMemcpyAsync(to, slot.memory.get(), from.size(), cudaMemcpyHostToDevice, stream),
        "cudaMemcpyAsync");
  check(cudaEventRecord(slot.finished.get(), stream), "cudaEventRecord");
  pending_uploads_ = slot.finished.get();
}

void UploadRing::join(cudaStream_t stream) {
  if (!pending_uploads_) return;
  check(cudaStreamWaitEvent(stream, pending_uploads_, 0), "cudaStreamWaitEvent");
  pending_uploads_ = nullptr;
}

}  // namespace ubs::cuda
