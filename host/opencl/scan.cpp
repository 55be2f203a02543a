// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/scan.hpp"

#include <algorithm>

#include "host/device/stage_sizes.hpp"

namespace ubs::opencl {
namespace {

constexpr std::uint64_t kLargestChunk = std::uint64_t{1} << 31;  // sizes are 32-bit

std::uint64_t divide_up(std::uint64_t value, std::uint64_t by) { return (value + by - 1) / by; }

}  // namespace

Blocks group_blocks(std::uint64_t elements) {
  constexpr std::uint32_t kBlock = stage_sizes::kGroupBlock;
  return {kBlock, std::max<std::size_t>(1, divide_up(elements, kBlock)), kGroupSize};
}

// Divides the elements into at most kMost blocks. The number of blocks is so small that each work-group can
// add the sums of all blocks before its own block.
Blocks few_group_blocks(std::uint64_t elements) {
  constexpr std::uint64_t kMost = 1024;  // the same as kAreaBlocks in kernels/opencl/tile_lists.cl
  const std::uint64_t size =
      std::max<std::uint64_t>(stage_sizes::kGroupBlock, round_up(divide_up(elements, kMost), kGroupSize));
  return {static_cast<std::uint32_t>(size), std::max<std::size_t>(1, divide_up(elements, size)), kGroupSize};
}

// Divides the elements into a number of chunks that is a multiple of the number of cores. For example, 30 000
// splats on two cores are divided into 8 chunks instead of 7, because with 7 chunks one core would process
// four of them.
Blocks chunk_blocks(std::uint64_t elements, std::size_t most, std::size_t cores) {
  std::uint64_t wanted =
      std::clamp<std::uint64_t>(elements / stage_sizes::kSmallestChunk, 1, std::max<std::size_t>(1, most));
  if (wanted > 1 && cores <= most)
    wanted = std::min<std::uint64_t>(round_up(wanted, cores), most / cores * cores);
  // Chunks consist of whole cache lines, so that no two chunks share one.
  const std::uint64_t size = std::max<std::uint64_t>(16, round_up(divide_up(elements, wanted), 16));
  if (size > kLargestChunk) return chunk_blocks(elements, 2 * wanted, cores);
  return {static_cast<std::uint32_t>(size), std::max<std::size_t>(1, divide_up(elements, size)), 1};
}

std::size_t most_chunks(const DeviceInfo& info) {
  return std::min<std::size_t>(stage_sizes::kMaxChunks, stage_sizes::kChunksPerCore * info.compute_units);
}

ProgramSpec with_scan(ProgramSpec spec, const KernelConfig& config, const char* in, const char* out) {
  if (config.raster == RasterKind::cpu)
    append(spec.sources, {"opencl/scan_chunks.cl"});
  else
    append(spec.sources, {"opencl/group_scan.cl", "opencl/scan.cl"});
  append(spec.options, {std::string("-DUBS_SCAN_IN=") + in, std::string("-DUBS_SUM=") + out});
  return spec;
}

Scan::Scan(OpenclDevice& device, const KernelConfig& config)
    : Scan(device, config, with_scan({}, config, "uint", "ulong")) {}

Scan::Scan(OpenclDevice& device, const KernelConfig& config, ProgramSpec widening)
    : device_(device),
      chunks_(config.raster == RasterKind::cpu),
      narrow_(device, with_scan({}, config, "uint", "uint")),
      widening_(device, std::move(widening)),
      wide_(device, with_scan({}, config, "ulong", "ulong")) {}

Blocks Scan::blocks(std::uint64_t elements) const {
  return chunks_ ? chunk_blocks(elements, most_chunks(device_.info()), device_.info().compute_units)
                 : few_group_blocks(elements);
}

template <typename In, typename Out>
void Scan::run(KernelSet& kernels, BufferView<In> in, BufferView<Out> out, std::uint32_t count,
               Buffer<Out>& sums) {
  const Blocks blocks = this->blocks(count);
  if (blocks.count > 1) {
    reserve(device_, sums, "scan sums", blocks.count);
    kernels[kScanSums<In, Out>](blocks.global(), blocks.group(), in, count, blocks.size, sums.view());
  }
  kernels[kScanWrite<In, Out>](blocks.global(), blocks.group(), in, count, blocks.size,
                               blocks.count > 1 ? sums.view() : BufferView<Out>{}, out);
}

void Scan::exclusive(BufferView<std::uint32_t> in, BufferView<std::uint32_t> out, std::uint32_t count) {
  run(narrow_, in, out, count, sums_narrow_);
}
void Scan::exclusive(BufferView<std::uint32_t> in, BufferView<std::uint64_t> out, std::uint32_t count) {
  run(widening_, in, out, count, sums_wide_);
}
void Scan::exclusive(BufferView<std::uint64_t> in, BufferView<std::uint64_t> out, std::uint32_t count) {
  run(wide_, in, out, count, sums_wide_);
}

}  // namespace ubs::opencl
