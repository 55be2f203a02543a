// SPDX-License-Identifier: Apache-2.0
// One pass of a radix sort for GPUs. Order of the kernels: histogram of (digit, block) -> prefix sums along its rows ->
// scatter. The first pass of each sort is combined with the kernels that make its keys (tile_lists.cl).
// The sort is stable: ranks inside a block come from prefix sums in element order and never depend on the order of
// atomics.

// Atomics are only used to count; counts do not depend on the order.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void radix_histogram(
    __global const uint* keys, uint most, __global const uint* counted, uint shift, __global uint* histogram) {
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

// One work-group processes one digit: it computes the exclusive prefix sums of the digit's row, and its total.
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

// offsets, totals: results of radix_rows. Only digit and place move in local memory; keys and payloads are read from
// the block, which is still in the cache. The second payload is optional: either both of its pointers are set, or both
// are null.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void radix_scatter(
    __global const uint* keys, __global const uint* values, __global const uint* values2, uint most,
    __global const uint* counted, uint shift, __global const uint* offsets, __global const uint* totals,
    __global uint* keys_out, __global uint* values_out, __global uint* values2_out) {
  const uint count = listed(most, counted);
  __local uint entries[kRadixBlock];
  __local ushort counters[kNibble * kGroup];
  __local uint scratch[kScanRoom];
  __local uint bins[kRadixBins];
  const uint me = (uint)get_local_id(0);
  const size_t begin = get_group_id(0) * kRadixBlock;
  if (begin >= count) return;  // with `counted`: beyond the number of elements
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
