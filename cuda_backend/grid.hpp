// SPDX-License-Identifier: Apache-2.0
// Functions and classes that compute grid sizes, launch kernels with one thread per element, and compute
// prefix sums.
#pragma once

#include <functional>
#include <optional>

#include "cuda_backend/cuda_device.hpp"

namespace ubs::cuda {

// Returns the number of blocks of `block` threads that cover `items`.
inline unsigned blocks(std::uint64_t items, unsigned block) {
  const std::uint64_t count = (items + block - 1) / block;
  if (count > 0x7fffffffu)
    fail(ErrorKind::memory, "{} elements are more than one launch of a CUDA kernel can process", items);
  return static_cast<unsigned>(count);
}

// MapKernels launches kernels of kernels/map with one thread per element. `find` returns the table of
// kernels; it is called at the first launch.
template <typename Table>
class MapKernels {
 public:
  MapKernels(CudaDevice& device, std::function<Table()> find, unsigned block = kMapBlock)
      : device_(device), find_(std::move(find)), block_(block) {}

  template <typename Signature, typename... Arguments>
  void launch(Declared<Signature> kernel, std::uint64_t elements, std::size_t rows,
              const Arguments&... arguments) {
    if (!table_) table_ = find_();
    const Kernel<Signature>& found = *table_;
    device_.launch(kernel.name, found, {blocks(elements, block_), static_cast<unsigned>(rows), 1}, block_,
                   arguments...);
  }
  template <typename Signature, typename... Arguments>
  void launch_each(Declared<Signature> kernel, std::uint64_t items, std::size_t rows,
                   const Arguments&... arguments) {
    launch(kernel, items, rows, arguments...);
  }
  unsigned lanes() const { return 1; }

 private:
  CudaDevice& device_;
  std::function<Table()> find_;
  std::optional<Table> table_;
  unsigned block_;  // threads per block
};

// Computes exclusive prefix sums.
class Sums {
 public:
  explicit Sums(CudaDevice& device) : device_(device) {}
  // `in` and `out` have count + 1 elements each. They may be the same buffer.
  void exclusive(BufferView<u32> in, BufferView<u32> out, u32 count) {
    device_.algorithm("place_drawn", [&](Workspace& workspace) {
      return scan_exclusive(workspace, pointer_of(in), pointer_of(out), count + 1, device_.stream());
    });
  }
  // `in` has count elements, and `out` has count + 1 elements.
  void exclusive(BufferView<u32> in, BufferView<u64> out, u32 count) {
    device_.fill_zero(*out.memory, 0, sizeof(u64));
    device_.algorithm("mcmc_prefix", [&](Workspace& workspace) {
      return scan_inclusive(workspace, pointer_of(in), pointer_of(out) + 1, count, device_.stream());
    });
  }

 private:
  CudaDevice& device_;
};

}  // namespace ubs::cuda
