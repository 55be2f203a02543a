// SPDX-License-Identifier: Apache-2.0
// The classes in this file transfer data between host and device through pinned host memory. Uploads are
// first copied to a ring of pinned buffers, so that the transfer is enqueued on the stream and the host
// continues immediately. If data were uploaded from pageable memory, the driver would wait for the stream
// first. In training, the upload of the learning rates would then block the host in every iteration.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "cuda_backend/cuda_api.hpp"
#include "host/device/device.hpp"

namespace ubs::cuda {

struct PinnedReleaser {
  void operator()(std::byte* memory) const { cudaFreeHost(memory); }
};
using PinnedMemory = std::unique_ptr<std::byte, PinnedReleaser>;
PinnedMemory pinned_memory(std::size_t bytes);

// Staging has eight pinned slots of 256 KiB, which are used in turn.
class Staging {
 public:
  Staging();

  // Enqueues a copy to the device on the stream. Returns as soon as `from` may be changed.
  void upload(void* to, std::span<const std::byte> from, cudaStream_t stream);
  // Copies from the device to `to`. Waits for all work on the stream and for the copy.
  void download(std::span<std::byte> to, const void* from, cudaStream_t stream);

 private:
  static constexpr std::size_t kSlots = 8, kSlotBytes = std::size_t{256} << 10;
  std::byte* slot(std::size_t index) const { return memory_.get() + index * kSlotBytes; }
  std::size_t take();  // returns a slot whose last copy has finished

  PinnedMemory memory_;
  std::array<EventHandle, kSlots> finished_;
  std::size_t next_ = 0;
};

// ReadBlocks holds small pinned blocks for copies that the host reads later. A call of cudaMallocHost for
// every copy would be too slow, so a block is reused after the CudaRead that used it has been destroyed.
class ReadBlocks {
 public:
  struct Block {
    PinnedMemory memory;
    EventHandle arrived;
  };
  static constexpr std::size_t kBytes = 4096;

  Block take();
  void give_back(Block block) { free_.push_back(std::move(block)); }

 private:
  std::vector<Block> free_;
};

// CudaRead is a copy of at most ReadBlocks::kBytes bytes from the device to the host. The constructor
// enqueues the copy on the stream. Then the caller must record the event arrived() on the same stream; wait()
// waits for this event.
class CudaRead final : public PendingRead {
 public:
  CudaRead(ReadBlocks& blocks, const void* from, std::size_t bytes, cudaStream_t stream);
  ~CudaRead() override;
  CudaRead(const CudaRead&) = delete;
  CudaRead& operator=(const CudaRead&) = delete;
  std::span<const std::byte> wait() override;
  cudaEvent_t arrived() const { return block_.arrived.get(); }

 private:
  ReadBlocks& blocks_;
  ReadBlocks::Block block_;
  std::size_t bytes_;
};

// UploadRing holds pinned copies of whole arrays that are uploaded on a separate stream. Unlike the slots of
// Staging, its buffers are as large as the arrays. With small slots, the host would have to wait for a free
// slot. It would then also wait for the main stream, because an upload starts only after the earlier work of
// the main stream.
class UploadRing {
 public:
  // Enqueues a copy to the device on the stream. Returns as soon as `from` may be changed. There are two
  // buffers, which are used alternately, so this function first waits for the upload before the previous one.
  void upload(void* to, std::span<const std::byte> from, cudaStream_t stream);
  // Makes `stream` wait for all uploads that have been enqueued so far.
  void join(cudaStream_t stream);

 private:
  struct Slot {
    PinnedMemory memory;
    std::size_t bytes = 0;
    EventHandle finished;
  };
  std::array<Slot, 2> slots_;
  std::size_t next_ = 0;
  // Event of the last upload after the last join(). It also covers earlier uploads, which are on the same
  // stream.
  cudaEvent_t pending_uploads_ = nullptr;
};

}  // namespace ubs::cuda
