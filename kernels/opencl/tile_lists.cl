// SPDX-License-Identifier: Apache-2.0
// This file contains the kernels that, together with those of radix_sort.cl, build the tile lists on GPUs. They select
// the visible splats, write (tile, splat, slot) in depth order, and find the first intersection of each tile. They also
// do the first pass of each sort. UBS_TILE_KEY is the type of the keys of the sort by tile, ushort or uint.

// For each block of splats, computes the histogram of the first digit of the depth keys of its visible splats, in the
// layout of radix_histogram, and the number of tiles of these splats (sums[block]).
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void count_sums(
    __global const uint* tile_counts, __global const uint* depth_keys, uint count, __global uint* histogram,
    __global ulong* sums) {
  __local ulong scratch[kScanRoom];
  __local uint bins[kRadixBins];
  const uint me = (uint)get_local_id(0);
  const size_t begin = get_group_id(0) * kRadixBlock, end = min(begin + kRadixBlock, (size_t)count);
  bins[me] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  ulong mine = 0;
  for (size_t i = begin + me; i < end; i += kGroup) {
    const uint tiles = tile_counts[i];
    mine += tiles;
    if (tiles > 0) atomic_inc(&bins[depth_keys[i] & kRadixMask]);
  }
  ulong total;
  group_exclusive(mine, scratch, &total);
  if (me == 0) sums[get_group_id(0)] = total;
  histogram[me * get_num_groups(0) + get_group_id(0)] = bins[me];
}

// Computes the exclusive prefix sums of each row of the histogram and the totals of the rows, like radix_rows. An
// additional work-group replaces `sums` by their exclusive prefix sums, and writes their total to sums[blocks].
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void count_rows(
    __global uint* histogram, uint blocks, __global uint* digits, __global ulong* sums) {
  __local ulong scratch[kScanRoom];
  const uint me = (uint)get_local_id(0), group = (uint)get_group_id(0);
  const int of_digit = group < kRadixBins;
  __global uint* row = histogram + (size_t)group * blocks;  // only used if of_digit
  ulong running = 0;
  for (uint begin = 0; begin < blocks; begin += kGroup) {
    const uint i = begin + me;
    ulong mine = 0, total;
    if (i < blocks) mine = of_digit ? row[i] : sums[i];
    const ulong before = running + group_exclusive(mine, scratch, &total);
    if (i < blocks && of_digit) row[i] = (uint)before;
    if (i < blocks && !of_digit) sums[i] = before;
    running += total;
  }
  if (me > 0) return;
  if (of_digit)
    digits[group] = (uint)running;
  else
    sums[blocks] = running;
}

// These functions pack the number of visible splats and the number of their tiles into one value, so that one sum over
// the work-group is enough. The number of tiles is in the lower 44 bits. These are sufficient, because a block has 2048
// splats with fewer than 2^32 tiles each.
UBS_FN ulong one_drawn(void) { return 1ul << 44; }
UBS_FN ulong packed_counts(uint tiles) { return tiles > 0 ? one_drawn() + tiles : 0; }

// Writes the keys and indices of the visible splats, sorted by the first digit of the key, and the first slot of each
// splat. `offsets`, `digits` and `sums` are results of count_rows. `totals` receives the numbers of visible splats and
// of intersections. `drawn` and `pairs` are null if the host waits for the totals. Otherwise they receive the same two
// numbers for the kernels that follow. If there are more than drawn_room visible splats or more than pairs_room
// intersections, both receive 0, and all tile counts are set to 0, so that the view becomes empty (as in clamp_to_capacity of
// map/lists.cl).
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void count_write(
    __global uint* tile_counts, __global const uint* depth_keys, uint count, __global const uint* offsets,
    __global const uint* digits, __global const ulong* sums, ulong drawn_room, ulong pairs_room,
    __global uint* keys, __global uint* ids, __global uint* slot_offsets, __global ulong* totals, __global uint* drawn,
    __global uint* pairs) {
  __local uint entries[kRadixBlock];
  __local ushort counters[kNibble * kGroup];
  __local ulong scratch[kScanRoom];
  __local uint bins[kRadixBins];
  const uint me = (uint)get_local_id(0);
  const size_t group = get_group_id(0), blocks = get_num_groups(0);
  const size_t block = group * kRadixBlock, begin = block + me * kRadixItems;
  const size_t end = min(begin + kRadixItems, (size_t)count);
  const ulong tiles = sums[blocks];
  ulong mine = 0, total;
  for (size_t i = begin; i < end; i++) mine += packed_counts(tile_counts[i]);
  bins[me] = 0;
  const ulong before = group_exclusive(mine, scratch, &total);
  const uint size = (uint)(total / one_drawn());
  uint place = (uint)(before / one_drawn());
  ulong slot = sums[group] + before % one_drawn();
  for (size_t i = begin; i < end; i++) {
    const uint of_splat = tile_counts[i];
    if (of_splat > 0) {
      const uint digit = depth_keys[i] & kRadixMask;
      entries[place++] = digit << 16 | (uint)(i - block);
      atomic_inc(&bins[digit]);
    }
    if (!UBS_FORWARD_ONLY) slot_offsets[i] = (uint)slot;
    slot += of_splat;
  }
  for (uint i = size + me; i < kRadixBlock; i += kGroup) entries[i] = kRadixMask << 16;  // padding, as in radix_scatter
  const uint visible = place_block(entries, counters, scratch, bins, offsets, digits);
  for (uint i = me; i < size; i += kGroup) {
    const uint to = bins[entries[i] >> 16] + i;
    const size_t from = block + (entries[i] & 0xffffu);
    keys[to] = depth_keys[from];
    ids[to] = (uint)from;
  }
  const int fits = !drawn || (visible <= drawn_room && tiles <= pairs_room);
  if (!fits)
    for (size_t i = begin; i < end; i++) tile_counts[i] = 0;
  if (group > 0 || me > 0) return;
  totals[0] = visible;
  totals[1] = tiles;
  if (!drawn) return;
  *drawn = fits ? visible : 0;
  *pairs = fits ? (uint)tiles : 0;
}

// Computes the exclusive prefix sums of the numbers of tiles of the splats in depth order. One work-group processes a
// block of `block` splats, which is a multiple of kGroup. `firsts` receives the prefix sums, which start at 0 in each
// block, and `sums` the totals of the blocks.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void area_sums(
    __global const uint* order, uint most, __global const uint* counted, __global const uint2* tile_rects, uint block,
    __global uint* firsts, __global uint* sums) {
  __local ulong scratch[kScanRoom];
  const uint me = (uint)get_local_id(0), count = listed(most, counted), items = block / kGroup;
  const size_t begin = get_group_id(0) * block + (size_t)me * items, end = min(begin + items, (size_t)count);
  uint mine = 0;
  for (size_t i = begin; i < end; i++) {
    const uint area = tile_rect_area(tile_rect(tile_rects[order[i]]));
    firsts[i] = area;
    mine += area;
  }
  ulong total;
  uint running = (uint)group_exclusive(mine, scratch, &total);
  for (size_t i = begin; i < end; i++) {
    const uint area = firsts[i];
    firsts[i] = running;
    running += area;
  }
  if (me == 0) sums[get_group_id(0)] = (uint)total;
}

enum { kAreaBlocks = 1024 };  // the largest number of blocks of area_sums

// Returns the block of area_sums in [low, high) that contains the intersection with the index `place`.
UBS_FN uint block_of(__local const uint* starts, uint low, uint high, uint place) {
  while (high - low > 1) {
    const uint middle = low + (high - low) / 2;
    if (starts[middle] <= place)
      low = middle;
    else
      high = middle;
  }
  return low;
}

// Writes the intersections in depth order, and computes the histogram of the first digit of their tiles in the layout
// of radix_histogram. Each work-group processes a block of kRadixBlock intersections, so that the work is balanced for
// rectangles of any size. The splat of an intersection is found by bisection. First the group finds the splats of its
// first and its last intersection. Then each work-item searches between these two, on average among 2048 / t splats,
// where t is the number of tiles per splat. `firsts` and `sums` are results of area_sums for blocks of `block` splats.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void emit_intersections(
    __global const uint* order, __global const uint* firsts, __global const uint* sums, uint block, uint most_drawn,
    __global const uint* drawn, uint most_pairs, __global const uint* pairs, __global const uint2* tile_rects,
    __global const uint* slot_offsets, uint tiles_x, __global UBS_TILE_KEY* tiles, __global uint* ids,
    __global uint* slots, __global uint* histogram, __global uint* long_lists) {
  __local ulong scratch[kScanRoom];
  __local uint starts[kAreaBlocks];  // index of the first intersection of each block of area_sums
  __local uint bins[kRadixBins], ends[2], end_blocks[2];
  const uint count = listed(most_drawn, drawn), intersections = listed(most_pairs, pairs);
  const uint me = (uint)get_local_id(0), blocks = (count + block - 1) / block, each = (blocks + kGroup - 1) / kGroup;
  const size_t begin = get_group_id(0) * kRadixBlock, end = min(begin + kRadixBlock, (size_t)intersections);
  if (begin + me == 0 && long_lists) *long_lists = 0;
  uint mine = 0;
  for (uint k = me * each; k < min((me + 1) * each, blocks); k++) mine += sums[k];
  ulong total;
  uint running = (uint)group_exclusive(mine, scratch, &total);
  for (uint k = me * each; k < min((me + 1) * each, blocks); k++) {
    starts[k] = running;
    running += sums[k];
  }
  bins[me] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (me < 2 && begin < end) {
    const uint place = (uint)(me == 0 ? begin : end - 1), of = block_of(starts, 0, blocks, place);
    end_blocks[me] = of;
    ends[me] = find_owner(firsts, of * block, min((of + 1) * block, count), place - starts[of]);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (size_t place = begin + me; place < end; place += kGroup) {
    const uint of = block_of(starts, end_blocks[0], end_blocks[1] + 1, (uint)place);
    const uint in_block = (uint)place - starts[of];
    const uint i = find_owner(firsts, max(of * block, ends[0]), min((of + 1) * block, ends[1] + 1), in_block);
    const uint number = in_block - firsts[i], id = order[i];
    const TileRect rect = tile_rect(tile_rects[id]);
    const uint width = tile_rect_width(rect), row = number / width;
    const uint tile = (rect.y0 + row) * tiles_x + rect.x0 + (number - row * width);
    tiles[place] = (UBS_TILE_KEY)tile;
    ids[place] = id;
    if (slots) slots[place] = slot_offsets[id] + number;
    atomic_inc(&bins[tile & kRadixMask]);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  histogram[me * get_num_groups(0) + get_group_id(0)] = bins[me];
}

// Finds the start of each tile's list by bisection. This also works for empty tiles. Sets *long_lists to 1 if a list
// has more than kLongList entries; emit_intersections has set it to 0 before.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void find_ranges(
    __global const UBS_TILE_KEY* tiles_sorted, uint most_pairs, __global const uint* pairs, uint tiles,
    __global uint* tile_ranges, __global uint* long_lists) {
  const uint intersections = listed(most_pairs, pairs);
  const size_t tile = get_global_id(0);
  if (tile > tiles) return;
  uint low = 0, high = intersections;  // first place with tiles_sorted >= tile
  while (low < high) {
    const uint middle = low + (high - low) / 2;
    if (tiles_sorted[middle] < tile)
      low = middle + 1;
    else
      high = middle;
  }
  tile_ranges[tile] = low;
  if (!long_lists || intersections - low <= kLongList) return;
  if (tiles_sorted[low + kLongList] == tile) atomic_or(long_lists, 1u);
}
