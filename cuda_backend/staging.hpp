// SPDX-License-Identifier: Apache-2.0
// Transfers through pinned host memory. Uploads are first copied to a ring of pinned buffers, so that the
// transfer is enqueued like a kernel and the host continues immediately. For pageable memory, the driver
// would wait for the stream first, so the upload of the learning rates would block the host in every
// iteration.
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

class Staging {
 public:
  Staging();

  // Returns as soon as `from` may be changed. The copy itself is ordered on the stream.
  void upload(void* to, std::span<const std::byte> from, cudaStream_t stream);
  // Waits for all work on the stream and then for the copy.
  void download(std::span<std::byte> to, const void* from, cudaStream_t stream);

 private:
  static constexpr std::size_t kSlots = 8, kSlotBytes = std::size_t{256} << 10;
  std::byte* slot(std::size_t index) const { return memory_.get() + index * kSlotBytes; }
  std::size_t take();  // returns a slot whose last copy has finished

  PinnedMemory memory_;
  std::array<EventHandle, kSlots> finished_;
  std::size_t next_ = 0;
};

// Small pinned blocks for copies that the host reads later. cudaMallocHost is too slow to call for every
// copy, so a block is reused after its reader has been destroyed.
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

// A copy of at most ReadBlocks::kBytes. The caller must record arrived() after the copy, or after the work
// that it is launched with.
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

// Pinned copies of whole arrays, which are uploaded on a separate stream. Unlike the slots above they are as
// large as the arrays, because waiting for a free slot would mean waiting for the stream that the uploads run
// in parallel with.
class UploadRing {
 public:
  // Returns as soon as `from` may be changed. Waits for the second to last upload, whose buffer it reuses.
  void upload(void* to, std::span<const std::byte> from, cudaStream_t stream);
  // Makes a stream wait for all uploads so far.
  void join(cudaStream_t stream);

 private:
  struct Slot {
    PinnedMemory memory;
    std::size_t bytes = 0;
    EventHandle finished;
  };
  std::array<Slot, 2> slots_;
  std::size_t next_ = 0;
  cudaEvent_t unjoined_ = nullptr;  // event of the last upload; earlier ones are on the same stream
};

}  // namespace ubs::cuda
