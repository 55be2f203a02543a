// SPDX-License-Identifier: Apache-2.0
// Adds the gradients of the parameter penalties to v_params. One work-item processes UBS_VW splats.

UBS_KERNEL void regularise(UBS_GLOBAL const real* params, UBS_GLOBAL real* v_params, uint count, uint stride,
                           PenaltyWeights weights) {
  uint first = UBS_GLOBAL_ID(0) * UBS_VW;
  if (first >= count) return;
  UBS_UNROLL for (int row = 0; row < kRowCount; ++row) {
    if (UBS_TRAINED_ROW(row + 1) == UBS_TRAINED_ROW(row) || !has_penalty(row, weights)) continue;
    UBS_GLOBAL real* to = v_params + (size_t)UBS_TRAINED_ROW(row) * stride + first;
    vreal raw = UBS_LOAD(params + (size_t)row * stride + first);
    UBS_STORE(UBS_LOAD(to) + penalty_vjp(row, raw, weights), to);
  }
}
