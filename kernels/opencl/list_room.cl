// SPDX-License-Identifier: Apache-2.0
// Before lists are built without the host knowing how long they are: takes the numbers that the other kernels go by
// from the totals, or, where there are more intersections than `room`, makes the view one without splats. So no
// kernel needs to guard its writes, and all after it, to the gradient, is the work of an empty view.
__kernel void fit_lists(__global const ulong* totals, ulong room, uint count, __global uint* tile_counts,
                        __global uint* drawn, __global uint* pairs) {
  const bool fits = totals[1] <= room;
  if (get_global_id(0) == 0) {
    *drawn = fits ? (uint)totals[0] : 0;
    *pairs = fits ? (uint)totals[1] : 0;
  }
  if (fits) return;
  for (size_t i = get_global_id(0); i < count; i += get_global_size(0)) tile_counts[i] = 0;
}
