// SPDX-License-Identifier: Apache-2.0
// Takes one Adam step of the twelve numbers that describe the appearance of an image, with one work-item per number.
// Then subtracts the mean over all images from the numbers of each image. Otherwise the colours of the model and the
// appearance of all images could change together without an effect on the loss. The bias corrections of Adam are stored
// with each image, as moments of the constant 1, because the images have taken different numbers of steps.

UBS_KERNEL void appearance_step(UBS_GLOBAL real* state, uint images, uint image, UBS_GLOBAL const real* gradient,
                                uint first_gradient, real rate_diagonal, real rate_other, real beta1, real beta2,
                                real epsilon, UBS_GLOBAL uint* sentinel, uint stamp) {
  int q = (int)UBS_GLOBAL_ID(0);
  if (q >= kAppearanceSize) return;
  real rate = appearance_diagonal(q) ? rate_diagonal : rate_other;
  if (rate == R(0.0)) return;
  if (sentinel) {
    uint seen = sentinel[0];
    if (seen != 0 && seen != stamp) return;
  }
  UBS_GLOBAL real* own = state + (size_t)image * kAppearanceState + q;
  real bias1 = beta1 * own[3 * kAppearanceSize] + (R(1.0) - beta1);
  real bias2 = beta2 * own[4 * kAppearanceSize] + (R(1.0) - beta2);
  AdamConstants adam = {beta1, beta2, epsilon, R(1.0) / bias1, R(1.0) / ubs_sqrt(bias2)};
  AdamState s = {own[0], own[kAppearanceSize], own[2 * kAppearanceSize]};
  s = adam_update(s, gradient[first_gradient + q], rate, adam);
  if (adam_not_finite(s)) {
    if (sentinel) sentinel[0] = stamp;
    return;
  }
  own[0] = s.param;
  own[kAppearanceSize] = s.moment1;
  own[2 * kAppearanceSize] = s.moment2;
  own[3 * kAppearanceSize] = bias1;
  own[4 * kAppearanceSize] = bias2;
  real mean = R(0.0);
  for (uint i = 0; i < images; ++i) mean += state[(size_t)i * kAppearanceState + q];
  mean /= (real)images;
  for (uint i = 0; i < images; ++i) state[(size_t)i * kAppearanceState + q] -= mean;
}
