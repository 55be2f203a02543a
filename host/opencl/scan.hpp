// SPDX-License-Identifier: Apache-2.0
// Scan computes exclusive prefix sums of device arrays. This header also declares functions that divide the
// elements of a stage into blocks for each kind of device. Neither Scan nor these functions wait for the
// device.
#pragma once

#include <cstdint>

#include "host/device/stages.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

// Blocks is a division of elements into blocks of equal size. On CPUs, one work-item processes a block, which
// is also called a chunk, and there are a few chunks per core. On GPUs, a group of 256 work-items processes a
// block.
struct Blocks {
  std::uint32_t size = 1;  // elements per block
  std::size_t count = 1;   // number of blocks, at least one
  std::size_t local = 1;   // work-items per group

  Range global() const { return {count * local}; }
  Range group() const { return {local}; }
};
constexpr std::size_t kGroupSize = 256;  // the same as kGroup in kernels/opencl/group_scan.cl
// Returns blocks of a fixed size for GPUs.
Blocks group_blocks(std::uint64_t elements);
// Returns at most `most` chunks for CPUs, if possible the same number for each core. Small inputs are divided
// into fewer chunks, because launching a chunk must not take longer than processing it.
Blocks chunk_blocks(std::uint64_t elements, std::size_t most, std::size_t cores);
// Returns the maximum number of chunks for a CPU device, which is a few per core.
std::size_t most_chunks(const DeviceInfo& info);

// Returns `spec` with the kernels for prefix sums. `in` is the type of the values and `out` the type of the
// sums.
ProgramSpec with_scan(ProgramSpec spec, const KernelConfig& config, const char* in, const char* out);

// Computes out[i] = in[0] + ... + in[i - 1] for i = 0 .. count. `out` has count + 1 elements: out[count] is
// the total, and out[i + 1] is the inclusive sum up to in[i]. 32-bit sums overflow without an error. Calls
// use the same scratch memory one after the other, in the order of the queue.
class Scan {
 public:
  Scan(OpenclDevice& device, const KernelConfig& config);
  // `widening` is a program of the caller that also contains the kernels for 64-bit sums of 32-bit values.
  // Then Scan needs one program less, which saves 0.05 s at the start of a process with PoCL.
  Scan(OpenclDevice& device, const KernelConfig& config, ProgramSpec widening);

  // Returns the blocks for this kind of device. Other passes over elements use them, too.
  Blocks blocks(std::uint64_t elements) const;
  void exclusive(BufferView<std::uint32_t> in, BufferView<std::uint32_t> out,
                 std::uint32_t count);  // `out` may be `in`
  void exclusive(BufferView<std::uint32_t> in, BufferView<std::uint64_t> out, std::uint32_t count);
  void exclusive(BufferView<std::uint64_t> in, BufferView<std::uint64_t> out,
                 std::uint32_t count);  // `out` may be `in`

 private:
  template <typename In, typename Out>
  void run(KernelSet& kernels, BufferView<In> in, BufferView<Out> out, std::uint32_t count,
           Buffer<Out>& sums);

  OpenclDevice& device_;
  bool chunks_;
  KernelSet narrow_, widening_, wide_;
  Buffer<std::uint32_t> sums_narrow_;  // sums of blocks
  Buffer<std::uint64_t> sums_wide_;
};

}  // namespace ubs::opencl
