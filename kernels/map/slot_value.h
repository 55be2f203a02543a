// SPDX-License-Identifier: Apache-2.0
// The sum over the slots of a splat by single values, where a slot is a gradient already (GPUs). Of more than kWideSplat
// slots it would take as long as that of all the others: a group then takes kSumParts parts side by side, part k every
// kSumParts-th slot from the k-th on, and adds them in their order.
#pragma once

enum {
  kWideSplat = 64,
  kSumParts = 16,
};

// Of `count` slots from `first` on every `step`-th. Those of mask 0 were never written: they may hold anything, NaN
// included.
UBS_FN float sum_of_value(uint first, uint count, uint step, uint value, UBS_SLOTS(UBS_GLOBAL const float*),
                          UBS_GLOBAL const ushort* masks) {
  float sum = 0.0f;
  for (uint k = 0; k < count; k += step) {
    uint slot = first + k;
    if (masks[slot] != 0) sum += UBS_SLOT_PIECE(slot)[(ulong)UBS_SLOT_IN_PIECE(slot) * kGradStride + value];
  }
  return sum;
}
