// SPDX-License-Identifier: Apache-2.0
// LateRead is a small copy of device memory to pinned host memory, which the host reads later
// (Device::read_later()).
#pragma once

#include <utility>
#include <vector>

#include "host/device/device.hpp"
#include "host/opencl/cl_api.hpp"
#include "host/opencl/pinned.hpp"

namespace ubs::opencl {

// ReadBlocks contains unused blocks of pinned memory of kBytes each. A block is reused after the LateRead
// that used it has been destroyed.
class ReadBlocks {
 public:
  static constexpr std::size_t kBytes = 8192;

  PinnedBlock take(cl_context context, cl_command_queue queue);
  void give_back(PinnedBlock block) { free_.push_back(std::move(block)); }

 private:
  std::vector<PinnedBlock> free_;
};

// The constructor starts a copy of at most ReadBlocks::kBytes bytes. wait() waits until it is complete.
class LateRead final : public PendingRead {
 public:
  LateRead(ReadBlocks& blocks, cl_context context, cl_command_queue queue, cl_mem from, std::size_t offset,
           std::size_t bytes);
  ~LateRead() override;
  LateRead(const LateRead&) = delete;
  LateRead& operator=(const LateRead&) = delete;
  std::span<const std::byte> wait() override;
  cl_event event() const { return event_.get(); }

 private:
  ReadBlocks& blocks_;
  PinnedBlock block_;
  std::size_t bytes_;
  EventHandle event_;
};

}  // namespace ubs::opencl
