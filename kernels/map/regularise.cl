// SPDX-License-Identifier: Apache-2.0
// Adds the gradients of the parameter penalties. x: UBS_VW splats per work-item; y: 0 for the opacity, 1..3 for the
// spatial scales.

UBS_KERNEL void regularise(UBS_GLOBAL const real* params, UBS_GLOBAL real* v_params, uint count, uint stride,
                           real opacity_weight, real scale_weight) {
  uint first = UBS_GLOBAL_ID(0) * UBS_VW;
  uint part = UBS_GLOBAL_ID(1);
  if (first >= count) return;
  size_t row = part == 0 ? kRowOpacity : kRowScale + part - 1;
  if (UBS_TRAINED_ROW(row + 1) == UBS_TRAINED_ROW(row)) return;
  UBS_GLOBAL real* to = v_params + UBS_TRAINED_ROW(row) * stride + first;
  vreal raw = UBS_LOAD(params + row * stride + first);
  vreal gradient = UBS_LOAD(to);
  if (part == 0)
    gradient += opacity_penalty_vjp(raw, opacity_weight);
  else
    gradient += scale_penalty_vjp(raw, scale_weight);
  UBS_STORE(gradient, to);
}
