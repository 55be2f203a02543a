// SPDX-License-Identifier: Apache-2.0
// Draws the sources of relocation and growth from the prefix sum of integer weights. Copies are counted
// with integer atomics, whose result does not depend on the order.

// The splat whose share [prefix[i], prefix[i + 1]) holds `ticket`; weight 0 is an empty share.
static inline uint find_share(__global const ulong* prefix, uint count, ulong ticket) {
  uint low = 0, high = count;  // prefix[low] <= ticket < prefix[high]
  while (high - low > 1) {
    uint middle = low + (high - low) / 2;
    if (prefix[middle] <= ticket)
      low = middle;
    else
      high = middle;
  }
  return low;
}

// 64 random bits times n, high word: uniform on 0 .. n - 1 but for a relative n / 2^64 (5e-6 for six
// million splats of opacity 1).
static inline ulong draw_below(RandomWords words, ulong n) {
  return mul_hi((ulong)words.x << 32 | words.y, n);
}

// Slot i draws a source if its weight is 0 (relocation, slots = count, `weights` given) or always
// (growth, `weights` null). totals[0] counts the slots that got one.
__kernel void mcmc_draw(__global const ulong* prefix, __global const uint* weights, uint count, uint slots,
                        uint purpose, uint seed0, uint seed1, uint iteration0, uint iteration1,
                        __global uint* sources, volatile __global uint* copies,
                        volatile __global uint* totals) {
  uint i = get_global_id(0);
  if (i >= slots) return;
  bool relocation = weights != 0;
  ulong total = prefix[count];
  sources[i] = UBS_NO_SOURCE;
  if (relocation && (weights[i] != 0 || total == 0)) return;
  RandomWords words = random_words(seed0, seed1, iteration0, iteration1, purpose, i);
  // Growth must fill its slots even if every opacity is zero or NaN: all splats are then alike.
  uint source =
      total > 0 ? find_share(prefix, count, draw_below(words, total)) : (uint)draw_below(words, count);
  sources[i] = source;
  atomic_inc(copies + source);
  atomic_inc(totals);
}
