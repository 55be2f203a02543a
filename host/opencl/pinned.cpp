// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/pinned.hpp"

#include <utility>

namespace ubs::opencl {

PinnedBlock::PinnedBlock(cl_context context, cl_command_queue queue, std::size_t bytes, Use use)
    : size_(bytes) {
  check(clRetainCommandQueue(queue), "clRetainCommandQueue");
  Unmap unmap{QueueHandle(queue), {}};
  cl_int code = CL_SUCCESS;
  unmap.memory.reset(
      clCreateBuffer(context, CL_MEM_READ_WRITE | CL_MEM_ALLOC_HOST_PTR, bytes, nullptr, &code));
  check(code, "clCreateBuffer");
  void* mapped = clEnqueueMapBuffer(queue, unmap.memory.get(), use == Use::write, CL_MAP_READ | CL_MAP_WRITE,
                                    0, bytes, 0, nullptr, nullptr, &code);
  check(code, "clEnqueueMapBuffer");
  bytes_ = {static_cast<std::byte*>(mapped), std::move(unmap)};
}

}  // namespace ubs::opencl
