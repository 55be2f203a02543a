// SPDX-License-Identifier: Apache-2.0
// What needs no cooperation in building tile lists.

// Before lists are built without the host knowing how long they are: takes the numbers that the other kernels go by
// from the totals, or, where there are more intersections than `room`, makes the view one without splats. So no
// kernel needs to guard its writes, and all after it, to the gradient, is the work of an empty view.
UBS_KERNEL void fit_lists(UBS_GLOBAL const ulong* totals, ulong room, uint count, uint items,
                          UBS_GLOBAL uint* tile_counts, UBS_GLOBAL uint* drawn, UBS_GLOBAL uint* pairs) {
  uint item = UBS_GLOBAL_ID(0);
  int fits = totals[1] <= room;
  if (item == 0) {
    *drawn = fits ? (uint)totals[0] : 0;
    *pairs = fits ? (uint)totals[1] : 0;
  }
  if (fits) return;
  for (size_t i = item; i < count; i += items) tile_counts[i] = 0;
}
