// SPDX-License-Identifier: Apache-2.0
// Replaces the first number of each row of `sums` by the sum of the row. `sums` has the shape (count, pitch).

UBS_KERNEL void row_sums(UBS_GLOBAL real* sums, int pitch, int count) {
  int row = (int)UBS_GLOBAL_ID(0);
  if (row >= count) return;
  UBS_GLOBAL real* from = sums + (size_t)row * pitch;
  vreal sum = V(0.0);
  for (int x = 0; x < pitch; x += UBS_VW) sum += UBS_LOAD(from + x);
  real lanes[UBS_VW], total = R(0.0);
  UBS_STORE(sum, lanes);
  for (int i = 0; i < UBS_VW; ++i) total += lanes[i];
  from[0] = total;
}
