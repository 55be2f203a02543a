// SPDX-License-Identifier: Apache-2.0
// Small helpers of every stage: numbers of blocks, buffers that grow.
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

// Content is lost when the buffer grows.
template <typename T>
void reserve(CudaDevice& device, Buffer<T>& buffer, const char* label, std::size_t size) {
  if (!buffer) buffer = Buffer<T>(device, label, 0);
  buffer.reserve(size);
}

}  // namespace ubs::cuda
