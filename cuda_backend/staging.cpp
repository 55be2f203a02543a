// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/staging.hpp"

#include <algorithm>
#include <cstring>

namespace ubs::cuda {

Staging::Staging() {
  for (EventHandle& event : finished_) event = make_event(false);
  void* memory = nullptr;
  check(cudaMallocHost(&memory, kSlots * kSlotBytes), "cudaMallocHost");
  memory_ = static_cast<std::byte*>(memory);
}

Staging::~Staging() { cudaFreeHost(memory_); }

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

void UploadRing::upload(void* to, std::span<const std::byte> from, cudaStream_t stream) {
  Slot& slot = slots_[next_];
  next_ = (next_ + 1) % slots_.size();
  if (slot.finished) check(cudaEventSynchronize(slot.finished.get()), "cudaEventSynchronize");
  if (!slot.finished) slot.finished = make_event(false);
  if (slot.bytes < from.size()) {
    slot.memory.reset();
    slot.bytes = 0;
    void* memory = nullptr;
    check(cudaMallocHost(&memory, from.size()), "cudaMallocHost");
    slot.memory.reset(static_cast<std::byte*>(memory));
    slot.bytes = from.size();
  }
  std::memcpy(slot.memory.get(), from.data(), from.size());
  check(cudaMemcpyAsync(to, slot.memory.get(), from.size(), cudaMemcpyHostToDevice, stream), "cudaMemcpyAsync");
  check(cudaEventRecord(slot.finished.get(), stream), "cudaEventRecord");
  unjoined_ = slot.finished.get();
}

void UploadRing::join(cudaStream_t stream) {
  if (!unjoined_) return;
  check(cudaStreamWaitEvent(stream, unjoined_, 0), "cudaStreamWaitEvent");
  unjoined_ = nullptr;
}

}  // namespace ubs::cuda
