// SPDX-License-Identifier: Apache-2.0
// Tile lists for GPUs: the stages around scan.cl and radix_sort.cl. They select the visible splats, write (tile, splat,
// slot) in depth order with one work-item per intersection, and find the first intersection of each tile.

// The number of visible splats of a block and the number of their tiles, packed into one value so that one sum over the
// group is enough. A block has 2048 splats with less than 2^32 tiles.
UBS_FN ulong one_drawn(void) { return 1ul << 44; }
UBS_FN ulong packed_counts(__global const uint* tile_counts, size_t i) {
  const uint tiles = tile_counts[i];
  return tiles > 0 ? one_drawn() + tiles : 0;
}

// sums[block] = number of visible splats, sums[blocks + block] = number of their tiles.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void count_sums(
    __global const uint* tile_counts, uint count, uint block, __global ulong* sums) {
  __local ulong scratch[kScanRoom];
  const uint me = (uint)get_local_id(0);
  const size_t begin = get_group_id(0) * block, end = min(begin + block, (size_t)count);
  ulong mine = 0;
  for (size_t i = begin + me; i < end; i += kGroup) mine += packed_counts(tile_counts, i);
  ulong total;
  group_exclusive(mine, scratch, &total);
  if (me == 0) {
    sums[get_group_id(0)] = total / one_drawn();
    sums[get_num_groups(0) + get_group_id(0)] = total % one_drawn();
  }
}

// sums: result of count_sums. keys: depth keys of the visible splats, to be sorted. totals: numbers of visible splats
// and of intersections.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void count_write(
    __global const uint* tile_counts, __global const uint* depth_keys, uint count, uint block,
    __global const ulong* sums, __global uint* visible_ids, __global uint* keys, __global uint* slot_offsets,
    __global ulong* totals) {
  __local ulong scratch[kScanRoom];
  const uint me = (uint)get_local_id(0), items = block / kGroup;
  const size_t group = get_group_id(0), blocks = get_num_groups(0);
  const size_t begin = group * block + (size_t)me * items, end = min(begin + items, (size_t)count);
  ulong mine = 0;
  for (size_t i = begin; i < end; i++) mine += packed_counts(tile_counts, i);
  ulong total;
  const ulong before = group_exclusive(mine, scratch, &total);
  size_t place = sum_before(sums, (uint)group, scratch) + before / one_drawn();
  ulong slot = sum_before(sums + blocks, (uint)group, scratch) + before % one_drawn();
  for (size_t i = begin; i < end; i++) {
    if (tile_counts[i] > 0) {
      visible_ids[place] = (uint)i;
      keys[place++] = depth_keys[i];
    }
    if (!UBS_FORWARD_ONLY) slot_offsets[i] = (uint)slot;
    slot += tile_counts[i];
  }
  if (group + 1 < blocks) return;
  const ulong drawn = sum_before(sums, (uint)blocks, scratch), tiles = sum_before(sums + blocks, (uint)blocks, scratch);
  if (me == 0) {
    totals[0] = drawn;
    totals[1] = tiles;
  }
}

// Computes the number of tiles of each splat in depth order, and the sums of these numbers by block. The prefix sums
// over all `most` elements are the places of the intersections.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void area_sums(
    __global const uint* order, uint most, __global const uint* counted, __global const uint2* tile_rects, uint block,
    __global uint* areas, __global uint* sums) {
  __local ulong scratch[kScanRoom];
  const uint me = (uint)get_local_id(0), count = listed(most, counted);
  const size_t begin = get_group_id(0) * block, end = min(begin + block, (size_t)most);
  uint sum = 0;
  for (size_t i = begin + me; i < end; i += kGroup) {
    const uint area = i < count ? tile_rect_area(tile_rect(tile_rects[order[i]])) : 0;
    areas[i] = area;
    sum += area;
  }
  ulong total;
  group_exclusive(sum, scratch, &total);
  if (me == 0) sums[get_group_id(0)] = (uint)total;
}

// Writes the intersections. The work is balanced for rectangles of any size: a work-item finds its splat by bisection.
// First the group finds the splats of its first and its last intersection; then each work-item searches between these
// two (on average among 256 / t candidates, where t is the number of tiles per splat).
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void emit_intersections(
    __global const uint* order, __global const uint* firsts, uint most_drawn,
    __global const uint* drawn, uint most_pairs, __global const uint* pairs, __global const uint2* tile_rects, __global const uint* slot_offsets, uint tiles_x, __global uint* tiles,
    __global uint* ids, __global uint* slots, __global uint* long_lists) {
  const uint count = listed(most_drawn, drawn), intersections = listed(most_pairs, pairs);
  __local uint ends[2];
  const uint me = (uint)get_local_id(0);
  const size_t place = get_global_id(0), begin = place - me;
  if (me < 2)
    ends[me] = find_owner(firsts, 0, count,
                          me == 0 ? begin : min(begin + kGroup, (size_t)intersections) - 1);
  barrier(CLK_LOCAL_MEM_FENCE);
  if (place == 0 && long_lists) *long_lists = 0;
  if (place >= intersections) return;
  const uint i = find_owner(firsts, ends[0], ends[1] + 1, place);
  const uint number = (uint)place - firsts[i], id = order[i];
  const TileRect rect = tile_rect(tile_rects[id]);
  const uint width = tile_rect_width(rect), row = number / width;
  tiles[place] = (rect.y0 + row) * tiles_x + rect.x0 + (number - row * width);
  ids[place] = id;
  if (slots) slots[place] = slot_offsets[id] + number;
}

// Finds the start of each tile's list by bisection. Empty tiles at the ends or in between need no special case.
// long_lists is set if a list is long; emit_intersections has cleared it.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void find_ranges(
    __global const uint* tiles_sorted, uint most_pairs, __global const uint* pairs, uint tiles,
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
