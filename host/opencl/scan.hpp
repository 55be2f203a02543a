// SPDX-License-Identifier: Apache-2.0
// Exclusive prefix sums of device arrays, and how a stage cuts its elements into blocks on each kind of
// device. Nothing here waits.
#pragma once

#include <cstdint>

#include "host/device/stages.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

// CPUs: one work-item a chunk, a few chunks a core. GPUs: one group of 256 a block of fixed size.
struct Blocks {
  std::uint32_t size = 1;  // elements a block
  std::size_t count = 1;   // blocks, at least one
  std::size_t local = 1;   // work-items a group

  Range global() const { return {count * local}; }
  Range group() const { return {local}; }
};
constexpr std::size_t kGroupSize = 256;  // kGroup
Blocks group_blocks(std::uint64_t elements);
// At most `most` chunks, the same number for each core; small inputs get fewer, because a chunk must be worth
// its launch.
Blocks chunk_blocks(std::uint64_t elements, std::size_t most, std::size_t cores);
// Chunks that keep the device busy.
std::size_t most_chunks(const DeviceInfo& info);

// The program with the kernels of sums of type `in` into sums of type `out` added to it.
ProgramSpec with_scan(ProgramSpec spec, const KernelConfig& config, const char* in, const char* out);

// out[i] = in[0] + ... + in[i - 1] for i = 0 .. count: `out` has count + 1 elements, so out[count] is the
// total and out[i + 1] the inclusive sum. 32-bit results wrap. Calls share scratch in queue order.
class Scan {
 public:
  Scan(OpenclDevice& device, const KernelConfig& config);
  // widening: a program that has the kernels of 32-bit values into 64-bit sums among its own; with a program
  // less a process of PoCL starts a twentieth of a second sooner.
  Scan(OpenclDevice& device, const KernelConfig& config, ProgramSpec widening);

  Blocks blocks(std::uint64_t elements) const;  // of this kind of device, also for other passes over elements
  void exclusive(BufferView<std::uint32_t> in, BufferView<std::uint32_t> out,
                 std::uint32_t count);  // out may be in
  void exclusive(BufferView<std::uint32_t> in, BufferView<std::uint64_t> out, std::uint32_t count);
  void exclusive(BufferView<std::uint64_t> in, BufferView<std::uint64_t> out,
                 std::uint32_t count);  // out may be in
  // The same where the sums of blocks(count) are there already.
  void exclusive_of_sums(BufferView<std::uint32_t> in, BufferView<std::uint32_t> sums,
                         BufferView<std::uint32_t> out, std::uint32_t count);

 private:
  template <typename In, typename Out>
  void run(KernelSet& kernels, BufferView<In> in, BufferView<Out> out, std::uint32_t count,
           Buffer<Out>& sums);

  OpenclDevice& device_;
  bool chunks_;
  KernelSet narrow_, widening_, wide_;
  Buffer<std::uint32_t> sums_narrow_;  // of blocks
  Buffer<std::uint64_t> sums_wide_;
};

}  // namespace ubs::opencl
