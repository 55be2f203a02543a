// SPDX-License-Identifier: Apache-2.0
// This file contains the kernels of an exclusive prefix sum for CPUs. They have the same names and arguments as those
// for GPUs in scan.cl. One work-item processes a chunk of `block` elements. Work-groups have one work-item, so that the
// compiler vectorises the loops. UBS_SCAN_IN is the type of the elements and UBS_SUM the type of the sums.

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void scan_sums(
    __global const UBS_SCAN_IN* restrict in, uint count, uint block, __global UBS_SUM* restrict sums) {
  const size_t begin = get_global_id(0) * block, end = min(begin + block, (size_t)count);
  UBS_SUM sum = 0;
  for (size_t i = begin; i < end; i++) sum += in[i];
  sums[get_global_id(0)] = sum;
}

// `sums` contains the sums of the chunks from scan_sums. There are few chunks, so each work-item adds the sums of all
// chunks before its own chunk.
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void scan_write(
    __global const UBS_SCAN_IN* in, uint count, uint block, __global const UBS_SUM* sums,
    __global UBS_SUM* out) {
  const size_t begin = get_global_id(0) * block, end = min(begin + block, (size_t)count);
  UBS_SUM running = 0;
  for (size_t k = 0; k < get_global_id(0); k++) running += sums[k];
  for (size_t i = begin; i < end; i++) {
    const UBS_SUM value = in[i];
    out[i] = running;
    running += value;
  }
  if (get_global_id(0) + 1 == get_global_size(0)) out[count] = running;
}
