// SPDX-License-Identifier: Apache-2.0
// This file contains the kernels of an exclusive prefix sum for GPUs. One work-group processes a block of `block`
// elements, which is a multiple of kGroup. scan_sums computes the sums of the blocks, then scan_write writes the
// result. UBS_SCAN_IN is the type of the elements and UBS_SUM the type of the sums, which wrap on overflow. `out` has
// count + 1 elements, the last of which is the total. `out` may be the same buffer as `in`.

__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void scan_sums(
    __global const UBS_SCAN_IN* in, uint count, uint block, __global UBS_SUM* sums) {
  __local UBS_SUM scratch[kScanRoom];
  const uint me = (uint)get_local_id(0);
  const size_t begin = (size_t)get_group_id(0) * block;
  const size_t end = min(begin + block, (size_t)count);
  UBS_SUM sum = 0;
  for (size_t i = begin + me; i < end; i += kGroup) sum += in[i];
  UBS_SUM total;
  group_exclusive(sum, scratch, &total);
  if (me == 0) sums[get_group_id(0)] = total;
}

// `sums` contains the sums of the blocks; it is null if there is only one block. There are few blocks, so each group
// adds the sums of all blocks before its own block.
__kernel __attribute__((reqd_work_group_size(kGroup, 1, 1))) void scan_write(
    __global const UBS_SCAN_IN* in, uint count, uint block, __global const UBS_SUM* sums,
    __global UBS_SUM* out) {
  __local UBS_SUM scratch[kScanRoom];
  const uint me = (uint)get_local_id(0), items = block / kGroup;
  const size_t begin = (size_t)get_group_id(0) * block + (size_t)me * items;
  const size_t end = min(begin + items, (size_t)count);
  UBS_SUM sum = 0;
  for (size_t i = begin; i < end; i++) sum += in[i];
  UBS_SUM total, base = 0;
  UBS_SUM running = group_exclusive(sum, scratch, &total);
  if (sums) base = sum_before(sums, (uint)get_group_id(0), scratch);
  running += base;
  for (size_t i = begin; i < end; i++) {
    const UBS_SUM value = in[i];
    out[i] = running;
    running += value;
  }
  if (me == 0 && get_group_id(0) + 1 == get_num_groups(0)) out[count] = base + total;
}
