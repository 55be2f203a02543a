// SPDX-License-Identifier: Apache-2.0
// Checks the lane exchange in the way in which raster_backward.cl uses it, with values whose sums the host knows
// (host/opencl/exchange.cpp). One work-group is launched. The blocks make different numbers of visits, as in the
// rasteriser. If an exchange compiles on a GPU but gives wrong values, the rasteriser sums through local memory
// instead.

#if UBS_BALLOT
// Returns whether a ballot of the wave contains the bits of the right work-items.
UBS_FN int ballot_is_right(int item) {
  uint lanes = ballot(item % 5 == 0), expected = 0;
  for (int lane = 0; lane < 32; ++lane) expected |= (uint)((item / 32 * 32 + lane) % 5 == 0) << lane;
  return lanes == expected;
}
#else
UBS_FN int ballot_is_right(int item) {
  (void)item;
  return 1;
}
#endif

// sums: (visit, block, value), for kBlocks visits. Block b makes the visits below kBlocks - b; the sums of the other
// visits are not written. If a ballot is wrong, no sums are written.
UBS_KERNEL UBS_WAVES UBS_GROUP(kItems) void exchange_check(UBS_GLOBAL float* sums) {
  UBS_EXCHANGE_LOCALS
  int item = ubs_item(), block = item / kLanes, lane = item % kLanes, holds = sum_of_lane(lane);
  int right = ballot_is_right(item);
  uint bits = 0xffffu >> block;
  while (any_of_wave(bits != 0)) {
    int active = bits != 0, visit = active ? lowest_bit32(bits) : 0;
    bits &= bits - 1;
    float all[kSums];
    UBS_UNROLL for (int i = 0; i < kSums; ++i) all[i] = (float)((item * 7 + visit * 3 + i * 5) % 64);
    float sum = sum_over_block(all, lane UBS_EXCHANGE_ARGUMENT);
    if (active && right && holds >= 0) sums[(visit * kBlocks + block) * kSums + holds] = sum;
  }
}
