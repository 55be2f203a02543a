// SPDX-License-Identifier: Apache-2.0
// PinnedBlock is a block of pinned host memory, which a device can read and write directly. With pageable
// memory, some drivers return from an asynchronous copy only when the copy has finished.
#pragma once

#include <cstddef>
#include <memory>

#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

// A block is mapped as long as it exists. It must outlive all copies that use it. It can be moved but not
// copied.
class PinnedBlock {
 public:
  // With `read`, the device writes the block and the host reads it. With `write`, the host writes the block
  // and the device reads it. Then the constructor waits for all work in the queue, so that the host may write
  // immediately.
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
    QueueHandle queue;  // the queue that mapped the block
    MemHandle memory;
  };
  std::unique_ptr<std::byte, Unmap> bytes_;
  std::size_t size_ = 0;
};

}  // namespace ubs::opencl
