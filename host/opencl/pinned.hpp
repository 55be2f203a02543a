// SPDX-License-Identifier: Apache-2.0
// Pinned host memory, which a device copies to and from by itself. With pageable memory some drivers return
// from a copy only when it has finished, even if it is asynchronous.
#pragma once

#include <cstddef>
#include <memory>

#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

// A block that stays mapped as long as it exists. It must outlive all copies that use it. Can be moved but
// not copied.
class PinnedBlock {
 public:
  // read: the device writes and the host reads. write: the host writes and the device reads; the constructor
  // then waits for all work in the queue, so that the host may write at once.
  enum class Use { read, write };

  PinnedBlock() = default;
  PinnedBlock(cl_context context, cl_command_queue queue, std::size_t bytes, Use use);

  std::size_t size() const { return size_; }
  std::byte* bytes() const { return bytes_.get(); }

 private:
  struct Unmap {
    void operator()(std::byte* bytes) const {
      clEnqueueUnmapMemObject(queue.get(), memory.get(), bytes, 0, nullptr, nullptr);
    }
    QueueHandle queue;  // the queue that it was mapped with
    MemHandle memory;
  };
  std::unique_ptr<std::byte, Unmap> bytes_;
  std::size_t size_ = 0;
};

}  // namespace ubs::opencl
