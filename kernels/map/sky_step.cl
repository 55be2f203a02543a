// SPDX-License-Identifier: Apache-2.0
// Takes one Adam step of the 27 numbers of a learnt sky (map/sky.cl), with one work-item per number. The gradients of
// the views of a batch are added in the order of the views. `state` contains the numbers, then their first and second
// moments. The first three numbers, the constant colour, are kept within [0, 1].

UBS_KERNEL void sky_step(UBS_GLOBAL real* state, UBS_GLOBAL const real* gradients, uint views, real rate,
                         real rate_harmonics, real beta1, real beta2, real epsilon, real inverse_bias1,
                         real inverse_sqrt_bias2, UBS_GLOBAL uint* sentinel, uint stamp) {
  int q = (int)UBS_GLOBAL_ID(0);
  if (q >= SKY_NUMBERS) return;
  if (q >= 3) rate = rate_harmonics;
  if (rate == R(0.0)) return;
  if (sentinel) {
    uint seen = sentinel[0];
    if (seen != 0 && seen != stamp) return;
  }
  real gradient = R(0.0);
  for (uint view = 0; view < views; ++view) gradient += gradients[(size_t)view * SKY_NUMBERS + q];
  AdamConstants adam = {beta1, beta2, epsilon, inverse_bias1, inverse_sqrt_bias2};
  AdamState s = {state[q], state[SKY_NUMBERS + q], state[2 * SKY_NUMBERS + q]};
  s = adam_update(s, gradient, rate, adam);
  if (adam_not_finite(s)) {
    if (sentinel) sentinel[0] = stamp;
    return;
  }
  if (q < 3) s.param = s.param < R(0.0) ? R(0.0) : s.param > R(1.0) ? R(1.0) : s.param;
  state[q] = s.param;
  state[SKY_NUMBERS + q] = s.moment1;
  state[2 * SKY_NUMBERS + q] = s.moment2;
}
