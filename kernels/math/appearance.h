// SPDX-License-Identifier: Apache-2.0
// From the colours of the model to those of one photograph (method.md 4.9): exposure and white balance. Twelve
// numbers a of an image, three rows of four, neutral where all are 0:
//   y_c = exp(a_cc) x_c + sum over k != c of a_ck x_k + a_c3.
// Of gains alone the diagonal is used and the rest stays 0.
#pragma once

enum {
  kAppearanceSize = 12,   // numbers of an image
  kAppearanceState = 60   // with two moments and two bias corrections each, which come in this order
};

UBS_FN int appearance_diagonal(int q) { return q == 0 || q == 5 || q == 10; }

// What the colour that number q belongs to is multiplied by.
UBS_FN real appearance_factor(int q, real a) { return appearance_diagonal(q) ? ubs_real_exp(a) : a; }
// d factor / d a.
UBS_FN real appearance_slope(int q, real a) { return appearance_diagonal(q) ? ubs_real_exp(a) : R(1.0); }
