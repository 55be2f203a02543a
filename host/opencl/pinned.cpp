// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/pinned.hpp"

#include <utility>

namespace ubs::opencl {

PinnedBlock::PinnedBlock(cl_context context, cl_command_queue queue, std::size_t bytes, Use use)
    : size_(bytes) {
  check(clRetainCommandQueue(queue), "clRetainCommandQueue");
  queue_.reset(queue);
  cl_int code = CL_SUCCESS;
  memory_.reset(clCreateBuffer(context, CL_MEM_READ_WRITE | CL_MEM_ALLOC_HOST_PTR, bytes, nullptr, &code));
  check(code, "clCreateBuffer");
  void* mapped = clEnqueueMapBuffer(queue, memory_.get(), use == Use::write, CL_MAP_READ | CL_MAP_WRITE, 0,
                                    bytes, 0, nullptr, nullptr, &code);
  check(code, "clEnqueueMapBuffer");
  bytes_ = static_cast<std::byte*>(mapped);
}

PinnedBlock::PinnedBlock(PinnedBlock&& other) noexcept
    : queue_(std::move(other.queue_)),
      memory_(std::move(other.memory_)),
      bytes_(std::exchange(other.bytes_, nullptr)),
      size_(std::exchange(other.size_, 0)) {}

PinnedBlock& PinnedBlock::operator=(PinnedBlock&& other) noexcept {
  if (this == &other) return *this;
  unmap();
  queue_ = std::move(other.queue_);
  memory_ = std::move(other.memory_);
  bytes_ = std::exchange(other.bytes_, nullptr);
  size_ = std::exchange(other.size_, 0);
  return *this;
}

void PinnedBlock::unmap() {
  if (bytes_) clEnqueueUnmapMemObject(queue_.get(), memory_.get(), bytes_, 0, nullptr, nullptr);
}

}  // namespace ubs::opencl
