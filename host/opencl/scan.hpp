// SPDX-License-Identifier: Apache-2.0
// Exclusive prefix sums of device arrays, and the division of a stage's elements into blocks on each kind of
// device. These functions do not wait for the device.
#pragma once

#include <cstdint>

#include "host/device/stages.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

// CPUs: one work-item per chunk, a few chunks per core. GPUs: one group of 256 work-items per block of fixed
// size.
struct Blocks {
  std::uint32_t size = 1;  // elements per block
  std::size_t count = 1;   // number of blocks, at least one
  std::size_t local = 1;   // work-items per group

  Range global() const { return {count * local}; }
  Range group() const { return {local}; }
};
constexpr std::size_t kGroupSize = 256;  // kGroup of kernels/opencl/group_scan.cl
Blocks group_blocks(std::uint64_t elements);
// Returns at most `most` chunks, the same number for each core. Small inputs get fewer chunks, because it
// must not take longer to launch a chunk than to process it.
Blocks chunk_blocks(std::uint64_t elements, std::size_t most, std::size_t cores);
// Returns the number of chunks that keeps the device busy.
std::size_t most_chunks(const DeviceInfo& info);

// Adds the kernels for sums of type `out` of values of type `in` to a program.
ProgramSpec with_scan(ProgramSpec spec, const KernelConfig& config, const char* in, const char* out);

// Computes out[i] = in[0] + ... + in[i - 1] for i = 0 .. count. `out` has count + 1 elements: out[count] is
// the total, and out[i + 1] the inclusive sum. 32-bit results wrap. Calls share scratch memory in the order
// of the queue.
class Scan {
 public:
  Scan(OpenclDevice& device, const KernelConfig& config);
  // widening: a program that also contains the kernels for 64-bit sums of 32-bit values. With one program
  // less, a process with PoCL starts a twentieth of a second sooner.
  Scan(OpenclDevice& device, const KernelConfig& config, ProgramSpec widening);

  // Returns the blocks for this kind of device. Also used for other passes over elements.
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
