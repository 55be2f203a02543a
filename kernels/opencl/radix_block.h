// SPDX-License-Identifier: Apache-2.0
// The functions of this file are parts of a radix sort on GPUs (radix_sort.cl, tile_lists.cl). The sort starts with the
// least significant digit, and sorts by a digit of 8 bits in each pass. One work-group processes a block of kRadixBlock
// elements.
enum {
  kRadixItems = 8,
  kRadixBlock = kGroup * kRadixItems,
  kRadixBins = 256,  // number of values of a digit; each work-item of a group processes one
  kRadixMask = kRadixBins - 1,
  kNibble = 16,
};

// Sorts the entries of a block by four of their bits, starting at bit `shift`. The sort is stable. An entry is
// digit << 16 | place, where `place` is the index of the element in the block. Each work-item has kRadixItems
// consecutive entries and one counter for each value of the four bits (nibble). A prefix sum over the counters in the
// order (nibble, work-item) gives the rank of every entry.
UBS_FN void sort_block(__local uint* entries, __local ushort* counters, __local UBS_SUM* scratch, uint shift) {
  const uint me = (uint)get_local_id(0);
  uint mine[kRadixItems];
  for (uint k = 0; k < kNibble; k++) counters[k * kGroup + me] = 0;
  for (uint k = 0; k < kRadixItems; k++) {
    mine[k] = entries[me * kRadixItems + k];
    counters[((mine[k] >> shift) & 15u) * kGroup + me]++;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  uint sum = 0;
  for (uint k = 0; k < kNibble; k++) sum += counters[me * kNibble + k];
  UBS_SUM total;
  uint running = (uint)group_exclusive(sum, scratch, &total);
  for (uint k = 0; k < kNibble; k++) {
    const uint value = counters[me * kNibble + k];
    counters[me * kNibble + k] = (ushort)running;
    running += value;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint k = 0; k < kRadixItems; k++)
    entries[counters[((mine[k] >> shift) & 15u) * kGroup + me]++] = mine[k];
  barrier(CLK_LOCAL_MEM_FENCE);
}

// Sorts the entries of a block by digit in local memory, first by the low nibble and then by the high nibble, so that
// entries with equal digits are consecutive. On entry, `bins` contains the number of entries for each digit. On return,
// it contains for each digit the difference between the place of an entry in the output and its place in the sorted
// block, which is the same for all entries with this digit. `offsets` and `totals` are results of radix_rows or
// count_rows. Returns the number of elements of all blocks. The function begins and ends with a barrier.
UBS_FN uint place_block(__local uint* entries, __local ushort* counters, __local UBS_SUM* scratch, __local uint* bins,
                        __global const uint* offsets, __global const uint* totals) {
  const uint me = (uint)get_local_id(0);
  barrier(CLK_LOCAL_MEM_FENCE);
  UBS_SUM total;
  const uint first = (uint)group_exclusive(bins[me], scratch, &total);
  const uint smaller = (uint)group_exclusive(totals[me], scratch, &total);
  bins[me] = smaller + offsets[me * get_num_groups(0) + get_group_id(0)] - first;
  barrier(CLK_LOCAL_MEM_FENCE);
  sort_block(entries, counters, scratch, 16);
  sort_block(entries, counters, scratch, 20);
  return (uint)total;
}
