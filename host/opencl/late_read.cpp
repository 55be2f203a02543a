// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/late_read.hpp"

#include <utility>

namespace ubs::opencl {

PinnedBlock ReadBlocks::take(cl_context context, cl_command_queue queue) {
  if (free_.empty()) return {context, queue, kBytes, PinnedBlock::Use::read};
  PinnedBlock block = std::move(free_.back());
  free_.pop_back();
  return block;
}

LateRead::LateRead(ReadBlocks& blocks, cl_context context, cl_command_queue queue, cl_mem from,
                   std::size_t offset, std::size_t bytes)
    : blocks_(blocks), bytes_(bytes) {
  if (bytes > ReadBlocks::kBytes)
    fail(ErrorKind::internal, "a deferred read of {} bytes is not supported", bytes);
  block_ = blocks_.take(context, queue);
  cl_event event = nullptr;
  check(clEnqueueReadBuffer(queue, from, CL_FALSE, offset, bytes, block_.bytes(), 0, nullptr, &event),
        "clEnqueueReadBuffer");
  event_.reset(event);
  check(clFlush(queue), "clFlush");
}

LateRead::~LateRead() {
  cl_event event = event_.get();
  clWaitForEvents(1, &event);  // the driver writes to the block until this event has completed
  blocks_.give_back(std::move(block_));
}

std::span<const std::byte> LateRead::wait() {
  cl_event event = event_.get();
  check(clWaitForEvents(1, &event), "clWaitForEvents");
  return {block_.bytes(), bytes_};
}

}  // namespace ubs::opencl
