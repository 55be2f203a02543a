// SPDX-License-Identifier: Apache-2.0
// Numbers of blocks.
#pragma once

#include "cuda_backend/cuda_device.hpp"

namespace ubs::cuda {

// Blocks of `block` threads that cover `items`.
inline unsigned blocks(std::uint64_t items, unsigned block) {
  const std::uint64_t count = (items + block - 1) / block;
  if (count > 0x7fffffffu)
    fail(ErrorKind::memory, "{} items exceed the largest grid of a CUDA launch", items);
  return static_cast<unsigned>(count);
}

}  // namespace ubs::cuda
