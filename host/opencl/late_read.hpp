// SPDX-License-Identifier: Apache-2.0
// Small copies to the host that it looks at later (Device::read_later). They go to pinned memory: from a copy
// to pageable memory, asynchronous or not, some drivers return only when it is done.
#pragma once

#include <vector>

#include "host/device/device.hpp"
#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

// Pinned blocks; one is used again when its reader is gone.
class ReadBlocks {
 public:
  struct Block {
    MemHandle memory;
    std::byte* bytes = nullptr;  // where it is mapped, for good
  };
  static constexpr std::size_t kBytes = 4096;

  Block take(cl_context context, cl_command_queue queue);
  void give_back(Block block) { free_.push_back(std::move(block)); }
  void unmap(cl_command_queue queue);  // before the queue ends

 private:
  std::vector<Block> free_;
};

// At most ReadBlocks::kBytes.
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
  ReadBlocks::Block block_;
  std::size_t bytes_;
  EventHandle event_;
};

}  // namespace ubs::opencl
