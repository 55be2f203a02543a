// SPDX-License-Identifier: Apache-2.0
// Takes the Adam step of all trained parameters in one launch. Dimension 0 of the launch enumerates the splats, with
// UBS_VW splats per work-item, and dimension 1 the rows of gradients and moments, which have only the rows of trained
// parameters (kernels/layout.h). The lanes from `count` to the next multiple of UBS_VW are padding and are updated as
// well.

UBS_KERNEL void adam_step(UBS_GLOBAL real* params, UBS_GLOBAL const real* v_params, UBS_GLOBAL real* moment1,
                          UBS_GLOBAL real* moment2, UBS_GLOBAL const real* learning_rates, uint count,
                          uint stride, real beta1, real beta2, real epsilon, real inverse_bias1,
                          real inverse_sqrt_bias2) {
  uint first = UBS_GLOBAL_ID(0) * UBS_VW;
  uint row = UBS_GLOBAL_ID(1);
  if (first >= count) return;
  size_t at = (size_t)row * stride + first;
  int param_row = adam_param_row((int)row);
  UBS_GLOBAL real* param = params + (size_t)param_row * stride + first;
  AdamConstants k = {beta1, beta2, epsilon, inverse_bias1, inverse_sqrt_bias2};
  AdamState s = adam_load(UBS_LOAD(param), moment1 + at, moment2 + at);
  adam_store(adam_update(s, UBS_LOAD(v_params + at), learning_rates[param_row], k), param, moment1 + at, moment2 + at);
}

// Takes the same step with a check for values that are not finite. If a new value is not finite, the kernel sets
// sentinel[0], which was 0 before, to `stamp`. The parameter keeps its old value, but its moments are updated, so that
// they show which parameter it was. Later steps, which have a different stamp, do nothing, so that the state stays
// unchanged until the host checks the sentinel. All work-items of a launch see 0 or their own stamp, so the result does
// not depend on their order.
UBS_KERNEL void adam_step_watched(UBS_GLOBAL real* params, UBS_GLOBAL const real* v_params,
                                  UBS_GLOBAL real* moment1, UBS_GLOBAL real* moment2,
                                  UBS_GLOBAL const real* learning_rates, uint count, uint stride, real beta1,
                                  real beta2, real epsilon, real inverse_bias1, real inverse_sqrt_bias2,
                                  UBS_GLOBAL uint* sentinel, uint stamp) {
  uint first = UBS_GLOBAL_ID(0) * UBS_VW;
  uint row = UBS_GLOBAL_ID(1);
  if (first >= count) return;
  uint seen = sentinel[0];
  if (seen != 0 && seen != stamp) return;
  size_t at = (size_t)row * stride + first;
  int param_row = adam_param_row((int)row);
  UBS_GLOBAL real* param = params + (size_t)param_row * stride + first;
  AdamConstants k = {beta1, beta2, epsilon, inverse_bias1, inverse_sqrt_bias2};
  vreal before = UBS_LOAD(param);
  AdamState s = adam_load(before, moment1 + at, moment2 + at);
  s = adam_update(s, UBS_LOAD(v_params + at), learning_rates[param_row], k);
  vmask bad = adam_not_finite(s);
  // Lanes from `count` on are ignored, because the values in the padding are undefined.
  if (ubs_any_lane(bad & (ubs_lane_indices(first) < (vuint)(count)))) sentinel[0] = stamp;
  s.param = bad ? before : s.param;
  adam_store(s, param, moment1 + at, moment2 + at);
}
