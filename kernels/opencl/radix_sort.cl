// SPDX-License-Identifier: Apache-2.0
// This file contains the kernels of one pass of a radix sort for GPUs. They run in this order: radix_histogram computes
// a histogram of (digit, block), radix_rows computes prefix sums along its rows, and radix_scatter moves the elements.
// The first pass of each sort is combined with the kernels that make its keys (tile_lists.cl).
// The sort is stable: ranks inside a block are prefix sums in the order of the elements, and never depend on the order
// of atomic operations.
// UBS_KEY is the type of the keys: uint for depths, and ushort or uint for tiles.

// Counts, for each digit, the elements of each block. The atomic operations only count, so their order has no effect.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void radix_histogram(
    __global const UBS_KEY* keys, uint most, __global const uint* counted, uint shift, __global uint* histogram) {
  const uint count = listed(most, counted);
  __local uint bins[kRadixBins];
  const uint me = (uint)get_local_id(0);
  const size_t begin = get_group_id(0) * kRadixBlock;
  const size_t end = min(begin + kRadixBlock, (size_t)count);
  bins[me] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (size_t i = begin + me; i < end; i += kGroup) atomic_inc(&bins[(keys[i] >> shift) & kRadixMask]);
  barrier(CLK_LOCAL_MEM_FENCE);
  histogram[me * get_num_groups(0) + get_group_id(0)] = bins[me];
}

// Computes the exclusive prefix sums of each row of the histogram, and the totals of the rows. One work-group processes
// the row of one digit.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void radix_rows(
    __global uint* histogram, uint blocks, __global uint* totals) {
  __local uint scratch[kScanRoom];
  const uint me = (uint)get_local_id(0);
  __global uint* row = histogram + get_group_id(0) * blocks;
  uint running = 0;
  for (uint begin = 0; begin < blocks; begin += kGroup) {
    const uint i = begin + me;
    uint total;
    const uint before = group_exclusive(i < blocks ? row[i] : 0, scratch, &total);
    if (i < blocks) row[i] = running + before;
    running += total;
  }
  if (me == 0) totals[get_group_id(0)] = running;
}

// Moves the elements to their places in the output. `offsets` and `totals` are results of radix_rows. In local memory,
// only the digits are sorted, each together with the index of its element in the block. Keys and values are then read
// from the input, whose block is still in the cache.
// values2 and values2_out are optional: either both of them are set, or both are null.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void radix_scatter(
    __global const UBS_KEY* keys, __global const uint* values, __global const uint* values2, uint most,
    __global const uint* counted, uint shift, __global const uint* offsets, __global const uint* totals,
    __global UBS_KEY* keys_out, __global uint* values_out, __global uint* values2_out) {
  const uint count = listed(most, counted);
  __local uint entries[kRadixBlock];
  __local ushort counters[kNibble * kGroup];
  __local uint scratch[kScanRoom];
  __local uint bins[kRadixBins];
  const uint me = (uint)get_local_id(0);
  const size_t begin = get_group_id(0) * kRadixBlock;
  if (begin >= count) return;  // this block has no elements; possible if `most` is only an upper bound
  const uint size = (uint)min((size_t)kRadixBlock, count - begin);

  bins[me] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint i = me; i < kRadixBlock; i += kGroup) {
    // Padding gets the largest digit and comes after all real entries, so it is sorted to the end.
    const uint digit = i < size ? (keys[begin + i] >> shift) & kRadixMask : kRadixMask;
    entries[i] = digit << 16 | i;
    if (i < size) atomic_inc(&bins[digit]);
  }
  place_block(entries, counters, scratch, bins, offsets, totals);

  for (uint i = me; i < size; i += kGroup) {
    const uint to = bins[entries[i] >> 16] + i;
    const size_t from = begin + (entries[i] & 0xffffu);
    keys_out[to] = keys[from];
    values_out[to] = values[from];
    if (values2) values2_out[to] = values2[from];
  }
}
