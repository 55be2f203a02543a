// SPDX-License-Identifier: Apache-2.0
// This file contains a kernel of the tile lists that both back ends use. Its work-items do not cooperate.

// This kernel runs before the lists are built, if the host does not know their length. It copies the numbers of visible
// splats and of intersections from the totals, for the kernels that follow. If one of these numbers is larger than its
// bound, drawn_room or pairs_room, the kernel turns the view into one without splats. So no later kernel has to guard
// its writes, and all kernels up to the gradient work as for an empty view.
UBS_KERNEL void clamp_to_capacity(UBS_GLOBAL const ulong* totals, ulong drawn_room, ulong pairs_room, uint count, uint items,
                          UBS_GLOBAL uint* tile_counts, UBS_GLOBAL uint* drawn, UBS_GLOBAL uint* pairs) {
  uint item = UBS_GLOBAL_ID(0);
  int fits = totals[0] <= drawn_room && totals[1] <= pairs_room;
  if (item == 0) {
    *drawn = fits ? (uint)totals[0] : 0;
    *pairs = fits ? (uint)totals[1] : 0;
  }
  if (fits) return;
  for (size_t i = item; i < count; i += items) tile_counts[i] = 0;
}
