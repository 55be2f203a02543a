// SPDX-License-Identifier: Apache-2.0
// Adam over all that is learnt in one launch: x = UBS_VW splats, y = row. The lanes between
// count and the next multiple of UBS_VW are padding of the rows and are updated along. Rows of gradients and
// moments are those that are learnt (kernels/layout.h).

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
  AdamConstants k;
  k.beta1 = beta1;
  k.beta2 = beta2;
  k.epsilon = epsilon;
  k.inverse_bias1 = inverse_bias1;
  k.inverse_sqrt_bias2 = inverse_sqrt_bias2;
  AdamState s;
  s.param = UBS_LOAD(param);
  s.moment1 = UBS_LOAD(moment1 + at);
  s.moment2 = UBS_LOAD(moment2 + at);
  s = adam_update(s, UBS_LOAD(v_params + at), learning_rates[param_row], k);
  UBS_STORE(s.param, param);
  UBS_STORE(s.moment1, moment1 + at);
  UBS_STORE(s.moment2, moment2 + at);
}
