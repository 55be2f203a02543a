// SPDX-License-Identifier: Apache-2.0
// Checks that the exchange of values between lanes works on a device, in the way in which raster_backward.cl uses it.
// The host knows the correct sums and compares them with those of this kernel (host/opencl/exchange.cpp). If an
// exchange compiles on a GPU but gives wrong sums, the rasteriser sums through local memory instead. One work-group is
// launched. In the rasteriser, a block of 16 work-items visits one splat after the other, and the blocks have different
// numbers of splats. Here too, the blocks make different numbers of visits.

#if UBS_BALLOT
// Returns whether the result of a ballot has exactly the bits of those work-items of the wave that voted yes.
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

// `sums` receives kSums sums for each of kBlocks visits of each block, in the order (visit, block, sum). Block b makes
// only kBlocks - b visits; the sums of its other visits are not written. If a ballot is wrong, no sums are written.
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
