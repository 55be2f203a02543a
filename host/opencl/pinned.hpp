// SPDX-License-Identifier: Apache-2.0
// Memory of the host that a device copies to and from by itself: of copies with pageable memory, asynchronous
// or not, some drivers return only when they are done.
#pragma once

#include <cstddef>
#include <memory>

#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

// A block that stays mapped as long as it lives, which no copy with it may outlive. Move-only.
class PinnedBlock {
 public:
  // For what the device writes and the host reads, or the other way round: then it waits for all that the
  // queue has to do, so that the host may write at once.
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
    QueueHandle queue;  // through which it is mapped
    MemHandle memory;
  };
  std::unique_ptr<std::byte, Unmap> bytes_;
  std::size_t size_ = 0;
};

}  // namespace ubs::opencl
