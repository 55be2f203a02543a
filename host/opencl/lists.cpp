// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/lists.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <span>
#include <string>
#include <utility>

#include "host/device/stage_sizes.hpp"

namespace ubs::opencl {
namespace {

constexpr std::uint32_t kKeyBits = 32;
constexpr std::size_t kDigits = std::size_t{1} << stage_sizes::kRadixBits;
// If a histogram has at most this many entries, a single work-item scans it. This takes at most 10 us and
// saves one launch.
constexpr std::size_t kSmallHistogram = std::size_t{1} << 17;
constexpr std::uint32_t kColumnBlock = 512;  // columns of a histogram that a work-item scans

// On CPUs, each pass of the depth sort orders the splats by one digit of their depth keys. Digits contains
// the number of bits of each digit. The depths of a scene differ in about 24 bits, so two passes with 12
// bits each are sufficient. The measured times of building the lists are, in milliseconds:
//
//     bits of a pass      10     11     12     13
//     number of passes     3      3      2      2
//     30K splats        0.28   0.28   0.26   0.26
//     100K splats       0.72   0.73   0.65   0.65
//     300K splats        2.0    2.1    1.8    1.9
//
// With 1M splats, 8 and 12 bits are equally fast. With 3M splats, the lists take 40 ms with 8 bits and 43 ms
// with 12 bits. A pass with 12 bits writes to 4096 places at the same time, which need too many cache lines
// and pages.
struct Digits {
  std::uint32_t first, widest;  // number of bits of the first digit, and maximum for each further digit
};
// kOfFew is used for fewer than kManySplats splats, and kOfMany for more.
constexpr Digits kOfFew{stage_sizes::kDigitOfFew, 13},
    kOfMany{stage_sizes::kDigitOfMany, stage_sizes::kDigitOfMany};

Digits digits(std::uint32_t splats) { return splats < stage_sizes::kManySplats ? kOfFew : kOfMany; }

// `tile_key` is the OpenCL type of the keys of the sort by tile. Only the kernels for groups have such keys.
ProgramSpec list_program(const KernelConfig& config, const std::string& tile_key) {
  ProgramSpec spec{
      {"opencl/group_scan.cl", "map/tile_rect.h", "opencl/radix_block.h", "opencl/tile_lists.cl"},
      {"-DUBS_SUM=ulong", "-DUBS_TILE_KEY=" + tile_key}};
  if (config.raster == RasterKind::cpu)
    spec = {{"map/tile_rect.h", "map/lists.cl", "opencl/tile_list_chunks.cl"}, {}};
  if (!config.backward) spec.options.push_back("-DUBS_FORWARD_ONLY=1");
  return spec;
}

ProgramSpec radix_program(const std::string& key) {
  return {{"opencl/group_scan.cl", "map/tile_rect.h", "opencl/radix_block.h", "opencl/radix_sort.cl"},
          {"-DUBS_SUM=uint", "-DUBS_KEY=" + key}};
}

Range grid(std::uint64_t items) { return {round_up(items, kGroupSize)}; }
constexpr Range kListGroup{kGroupSize};

}  // namespace

Lists::Lists(OpenclDevice& device, const KernelConfig& config)
    : device_(device),
      chunks_(config.raster == RasterKind::cpu),
      core_groups_(device, chunks_ ? cores_for_groups(device) : 0),
      kernels_(device, core_groups_.program(list_program(config, "ushort"))),
      wide_kernels_(device, core_groups_.program(list_program(config, "uint"))),
      narrow_radix_(device, radix_program("ushort")),
      wide_radix_(device, radix_program("uint")),
      scan_(device, config) {}

template <typename T>
BufferView<T> Lists::scratch(Buffer<T>& buffer, std::size_t size) {
  reserve(device_, buffer, "tile list scratch", std::max<std::size_t>(size, 1));
  return buffer.view();
}

ListTotals Lists::run(const CountLists& lists) {
  return chunks_ ? count_by_chunks(lists) : count_by_groups(lists);
}

void Lists::fit(const CountLists& lists, const Blocks& blocks) {
  for (Words* words : {&drawn_, &pairs_}) reserve(device_, *words, "tile list sums", 1);
  kernels_[kFitLists](blocks.global(), blocks.group(), lists.totals, lists.room.visible,
                      lists.room.intersections, lists.count, static_cast<std::uint32_t>(blocks.global().x),
                      lists.tile_counts, drawn_.view(), pairs_.view());
}

void Lists::run(const BuildLists& lists) {
  if (lists.totals.intersections > UINT32_MAX || lists.totals.visible > lists.count ||
      lists.shape.tiles() < 1)
    fail(ErrorKind::internal,
         "tile lists: invalid sizes: {} intersections (at most {}), {} visible splats (at most {}), {} tiles "
         "(at least 1)",
         lists.totals.intersections, UINT32_MAX, lists.totals.visible, lists.count, lists.shape.tiles());
  const auto drawn = static_cast<std::uint32_t>(lists.totals.visible);
  const auto pairs = static_cast<std::uint32_t>(lists.totals.intersections);
  const Job job = lists.bounded ? Job{lists, {drawn, drawn_.view()}, {pairs, pairs_.view()}}
                                : Job{lists, {drawn}, {pairs}};
  if (chunks_)
    place_by_chunks(job, depth_order_by_chunks(job));
  else if (lists.shape.tiles() <= stage_sizes::kMaxNarrowTiles)
    place_by_groups<std::uint16_t>(job, depth_order_by_groups(job), kernels_, narrow_radix_);
  else
    place_by_groups<std::uint32_t>(job, depth_order_by_groups(job), wide_kernels_, wide_radix_);
}

// ---- CPUs (by chunks) -------------------------------------------------------------------------------

// The first digit consists of the lowest bits of the key itself. Its pass does not depend on the smallest and
// the largest key, so it can run while the host waits for these two keys.
ListTotals Lists::count_by_chunks(const CountLists& lists) {
  const bool waits = lists.totals.size == 0;
  const Blocks blocks = scan_.blocks(lists.count);
  first_bits_ = digits(lists.count).first;
  const std::uint32_t bins = 1u << first_bits_;
  reserve(device_, chunk_sums_, "tile list sums", blocks.count);
  const BufferView<std::uint64_t> pairs = scratch(counted_, round_up(lists.count, 8) + 8 * blocks.count);
  const BufferView<std::uint32_t> histogram = scratch(histogram_, blocks.count * bins);
  const BufferView<std::uint32_t> starts = scratch(starts_, bins + 1);
  core_groups_.launch(kernels_[kChunkSums], blocks.count, lists.tile_counts, lists.depth_keys, lists.count,
                      blocks.size, first_bits_, chunk_sums_.view(), histogram);
  static_assert(stage_sizes::kMaxChunks * sizeof(ChunkSums) <= ReadBlocks::kBytes);
  std::unique_ptr<PendingRead> read;
  if (waits) read = device_.read_later(*chunk_sums_.view().memory, 0, blocks.count * sizeof(ChunkSums));
  scan_columns(blocks.count, bins, starts);
  core_groups_.launch(kernels_[kChunkWrite], blocks.count, lists.tile_counts, lists.depth_keys, lists.count,
                      blocks.size, first_bits_, chunk_sums_.view(), histogram, starts, lists.slot_offsets,
                      pairs, lists.totals);
  if (waits) return add_sums(read->wait());
  least_ = 0;
  largest_ = UINT32_MAX;
  fit(lists, blocks);
  return lists.room;
}

ListTotals Lists::add_sums(std::span<const std::byte> chunks) {
  ListTotals totals;
  least_ = UINT32_MAX;
  largest_ = 0;
  for (; !chunks.empty(); chunks = chunks.subspan(sizeof(ChunkSums))) {
    ChunkSums sums;
    std::memcpy(&sums, chunks.data(), sizeof sums);
    totals.visible += sums[0];
    totals.intersections += sums[1];
    least_ = std::min(least_, static_cast<std::uint32_t>(sums[2]));
    largest_ = std::max(largest_, static_cast<std::uint32_t>(sums[3]));
  }
  return totals;
}

// Enqueues the passes after the first one. They sort by those bits above the first digit that are not equal
// in all keys. These bits are taken from key - base. The bits of the first digit are 0 in `base`, so that
// `key` and key - base have the same first digit.
BufferView<std::uint32_t> Lists::depth_order_by_chunks(const Job& job) {
  const std::uint32_t most = job.drawn.most, top = first_bits_;
  const std::uint32_t base = least_ >> top << top;
  const auto left =
      static_cast<std::uint32_t>(std::bit_width(largest_ > base ? (largest_ - base) >> top : 0));
  const std::uint32_t widest = digits(job.lists.count).widest;
  // The last pass writes the indices, so at least one pass is needed.
  const std::uint32_t passes = std::max(1u, (left + widest - 1) / widest);
  const Blocks blocks = scan_.blocks(most);
  const BufferView<std::uint32_t> order = scratch(ids_a_, most);
  BufferView<std::uint64_t> from = counted_.view();
  for (std::uint32_t pass = 0; pass < passes; ++pass) {
    const std::uint32_t shift = top + left * pass / passes, bits = top + left * (pass + 1) / passes - shift;
    const std::uint32_t bins = 1u << bits;
    const bool last = pass + 1 == passes;
    const BufferView<std::uint32_t> histogram = scratch(histogram_, blocks.count * bins);
    const BufferView<std::uint32_t> starts = scratch(starts_, bins + 1);
    const BufferView<std::uint64_t> to =
        last ? BufferView<std::uint64_t>{} : scratch(pass % 2 == 0 ? pairs_a_ : pairs_b_, most);
    core_groups_.launch(kernels_[kChunkHistogram], blocks.count, from, job.drawn.most, job.drawn.counted,
                        blocks.size, base, shift, bits, histogram);
    scan_columns(blocks.count, bins, starts);
    core_groups_.launch(kernels_[kChunkScatter], blocks.count, from, job.drawn.most, job.drawn.counted,
                        blocks.size, base, shift, bits, histogram, starts, to,
                        last ? order : BufferView<std::uint32_t>{});
    from = to;
  }
  return order;
}

void Lists::place_by_chunks(const Job& job, BufferView<std::uint32_t> order) {
  const BuildLists& lists = job.lists;
  const auto tiles = static_cast<std::uint32_t>(lists.shape.tiles());
  const auto tiles_x = static_cast<std::uint32_t>(lists.shape.tiles_x());
  // Each chunk clears a row of the histogram, which has an entry for each tile. This is worthwhile only if a
  // chunk has at least as many intersections as there are tiles.
  const std::size_t cores = device_.info().compute_units;
  const std::size_t most =
      std::min({most_chunks(device_.info()), static_cast<std::size_t>(stage_sizes::kMaxBins / tiles),
                std::max<std::size_t>(cores, job.pairs.most / tiles)});
  const Blocks blocks = chunk_blocks(job.drawn.most, most, cores);
  const BufferView<std::uint32_t> histogram = scratch(histogram_, blocks.count * tiles);
  core_groups_.launch(kernels_[kTileHistogram], blocks.count, order, lists.tile_rects, job.drawn.most,
                      job.drawn.counted, blocks.size, tiles_x, tiles, histogram);
  scan_columns(blocks.count, tiles, lists.tile_ranges);
  core_groups_.launch(kernels_[kTileScatter], blocks.count, order, lists.tile_rects, lists.slot_offsets,
                      job.drawn.most, job.drawn.counted, blocks.size, tiles_x, tiles, histogram,
                      lists.tile_ranges, lists.sorted_ids, lists.sorted_slots);
}

// Replaces each entry (chunk, bin) of histogram_ by the position of its first element relative to the start
// of the bin, and writes the start of each bin to `starts` (bins + 1 values).
void Lists::scan_columns(std::size_t chunks, std::uint32_t bins, BufferView<std::uint32_t> starts) {
  if (chunks * bins <= kSmallHistogram) {
    kernels_[kColumnStarts](Range{1}, Range{1}, histogram_.view(), static_cast<std::uint32_t>(chunks), bins,
                            starts);
    return;
  }
  kernels_[kColumnScan](Range{(bins + kColumnBlock - 1) / kColumnBlock}, Range{1}, histogram_.view(),
                        static_cast<std::uint32_t>(chunks), bins, kColumnBlock, starts);
  scan_.exclusive(starts, starts, bins);
}

// ---- GPUs (by groups) -------------------------------------------------------------------------------

// The kernels that count the splats also do the first pass of the depth sort. They read the keys that the
// projection has written, and skip splats that are not visible.
ListTotals Lists::count_by_groups(const CountLists& lists) {
  const bool waits = lists.totals.size == 0;
  const Blocks blocks = group_blocks(lists.count);
  const BufferView<std::uint32_t> histogram = scratch_histogram(blocks);
  reserve(device_, sums_, "tile list sums", blocks.count + 1);
  if (waits) reserve(device_, totals_, "tile list totals", 2);
  if (!waits)
    for (Words* words : {&drawn_, &pairs_}) reserve(device_, *words, "tile list sums", 1);
  kernels_[kCountSums](blocks.global(), blocks.group(), lists.tile_counts, lists.depth_keys, lists.count,
                       histogram, sums_.view());
  kernels_[kCountRows](Range{(kDigits + 1) * kGroupSize}, kListGroup, histogram,
                       static_cast<std::uint32_t>(blocks.count), digits_.view(), sums_.view());
  kernels_[kCountWrite](blocks.global(), blocks.group(), lists.tile_counts, lists.depth_keys, lists.count,
                        histogram, digits_.view(), sums_.view(), lists.room.visible, lists.room.intersections,
                        scratch(keys_a_, lists.count), scratch(ids_a_, lists.count), lists.slot_offsets,
                        waits ? totals_.view() : lists.totals,
                        waits ? BufferView<std::uint32_t>{} : drawn_.view(),
                        waits ? BufferView<std::uint32_t>{} : pairs_.view());
  if (!waits) return lists.room;
  std::array<std::uint64_t, 2> totals{};
  totals_.download(std::span<std::uint64_t>(totals));
  return {totals[0], totals[1]};
}

BufferView<std::uint32_t> Lists::depth_order_by_groups(const Job& job) {
  const std::uint32_t most = job.drawn.most;
  Pairs<std::uint32_t> from{keys_a_.view(), ids_a_.view(), {}};
  Pairs<std::uint32_t> to{scratch(keys_b_, most), scratch(ids_b_, most), {}};
  for (std::uint32_t shift = stage_sizes::kRadixBits; shift < kKeyBits; shift += stage_sizes::kRadixBits) {
    radix_pass(wide_radix_, from, to, job.drawn, shift, false);
    std::swap(from, to);
  }
  return from.values;
}

template <typename Key>
void Lists::place_by_groups(const Job& job, BufferView<std::uint32_t> order, KernelSet& kernels,
                            KernelSet& radix) {
  const BuildLists& lists = job.lists;
  const auto tiles = static_cast<std::uint32_t>(lists.shape.tiles());
  const auto tiles_x = static_cast<std::uint32_t>(lists.shape.tiles_x());
  const std::uint32_t drawn = job.drawn.most, pairs = job.pairs.most;
  const BufferView<std::uint32_t> firsts = scratch(starts_, drawn);
  const Blocks areas = scan_.blocks(drawn);
  const BufferView<std::uint32_t> sums = scratch(area_sums_, areas.count);
  kernels_[kAreaSums](areas.global(), areas.group(), order, job.drawn.most, job.drawn.counted,
                      lists.tile_rects, areas.size, firsts, sums);

  const auto keys = [&](Words& buffer) {
    constexpr std::size_t kEach = sizeof(std::uint32_t) / sizeof(Key);  // keys per word
    return BufferView<Key>{scratch(buffer, (pairs + kEach - 1) / kEach).memory, pairs};
  };
  Pairs<Key> from{keys(tiles_a_), lists.sorted_ids, lists.sorted_slots};
  Pairs<Key> to{keys(tiles_b_), scratch(pair_ids_, pairs),
                lists.sorted_slots.size > 0 ? scratch(pair_slots_, pairs) : BufferView<std::uint32_t>{}};
  const auto bits = static_cast<std::uint32_t>(std::bit_width(tiles - 1));
  // After an even number of passes, the result is in the buffers that the first pass reads. After an odd
  // number, it is in the other buffers.
  if ((bits + stage_sizes::kRadixBits - 1) / stage_sizes::kRadixBits % 2 == 1) std::swap(from, to);
  const Blocks blocks = group_blocks(pairs);
  kernels[kEmitIntersections<Key>](blocks.global(), blocks.group(), order, firsts, sums, areas.size,
                                   job.drawn.most, job.drawn.counted, job.pairs.most, job.pairs.counted,
                                   lists.tile_rects, lists.slot_offsets, tiles_x, from.keys, from.values,
                                   from.values2, scratch_histogram(blocks), lists.long_lists);
  for (std::uint32_t shift = 0; shift < bits; shift += stage_sizes::kRadixBits) {
    radix_pass(radix, from, to, job.pairs, shift, shift == 0);
    std::swap(from, to);
  }
  kernels[kFindRanges<Key>](grid(tiles + std::uint64_t{1}), kListGroup, from.keys, job.pairs.most,
                            job.pairs.counted, tiles, lists.tile_ranges, lists.long_lists);
}

BufferView<std::uint32_t> Lists::scratch_histogram(const Blocks& blocks) {
  reserve(device_, digits_, "digits", kDigits);
  return scratch(histogram_, blocks.count * kDigits);
}

template <typename Key>
void Lists::radix_pass(KernelSet& radix, const Pairs<Key>& from, const Pairs<Key>& to,
                       const ElementCount& count, std::uint32_t shift, bool has_histogram) {
  if (count.most == 0) return;
  const Blocks blocks = group_blocks(count.most);
  const BufferView<std::uint32_t> histogram = scratch_histogram(blocks);
  if (!has_histogram)
    radix[kRadixHistogram<Key>](blocks.global(), blocks.group(), from.keys, count.most, count.counted, shift,
                                histogram);
  radix[kRadixRows](Range{kDigits * kGroupSize}, kListGroup, histogram,
                    static_cast<std::uint32_t>(blocks.count), digits_.view());
  radix[kRadixScatter<Key>](blocks.global(), blocks.group(), from.keys, from.values, from.values2, count.most,
                            count.counted, shift, histogram, digits_.view(), to.keys, to.values, to.values2);
}

}  // namespace ubs::opencl
