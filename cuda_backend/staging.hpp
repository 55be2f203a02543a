// SPDX-License-Identifier: Apache-2.0
// A ring of pinned host memory through which uploads pass, so that they are enqueued like a kernel and the
// host goes on at once. From pageable memory the driver would wait for the stream first, and the learning
// rates that go up in every iteration would stop the host in every iteration.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <span>

#include "cuda_backend/cuda_api.hpp"

namespace ubs::cuda {

class Staging {
 public:
  Staging();
  ~Staging();
  Staging(const Staging&) = delete;
  Staging& operator=(const Staging&) = delete;

  // Returns when `from` may change; the copy itself takes its place on the stream.
  void upload(void* to, std::span<const std::byte> from, cudaStream_t stream);
  // Waits for everything on the stream and then for the copy.
  void download(std::span<std::byte> to, const void* from, cudaStream_t stream);

 private:
  static constexpr std::size_t kSlots = 8, kSlotBytes = std::size_t{256} << 10;
  std::byte* slot(std::size_t index) const { return memory_ + index * kSlotBytes; }
  std::size_t take();  // a slot whose last copy has finished

  std::byte* memory_ = nullptr;
  std::array<EventHandle, kSlots> finished_;
  std::size_t next_ = 0;
};

// Pinned copies of whole arrays on their way to the device on a stream of their own. They are as large as the
// arrays, unlike the slots above: waiting for a slot would wait for the stream that they are to run beside.
class UploadRing {
 public:
  // Returns when `from` may change; waits for the upload before the last one.
  void upload(void* to, std::span<const std::byte> from, cudaStream_t stream);
  // Lets a stream wait for all uploads so far.
  void join(cudaStream_t stream);

 private:
  struct Releaser {
    void operator()(std::byte* memory) const { cudaFreeHost(memory); }
  };
  struct Slot {
    std::unique_ptr<std::byte, Releaser> memory;
    std::size_t bytes = 0;
    EventHandle finished;
  };
  std::array<Slot, 2> slots_;
  std::size_t next_ = 0;
  cudaEvent_t unjoined_ = nullptr;  // of the last upload; those before it are on the same stream
};

}  // namespace ubs::cuda
