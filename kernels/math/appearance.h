// SPDX-License-Identifier: Apache-2.0
// Maps the colours of the model to those of one photograph, to correct exposure and white balance (method.md 4.9). Each
// image has twelve numbers a, three rows of four, which are neutral if all are 0:
//   y_c = exp(a_cc) x_c + sum over k != c of a_ck x_k + a_c3.
// With `appearance gain` only the diagonal is used; the other numbers stay 0.
#pragma once

enum {
  kAppearanceSize = 12,   // numbers per image
  // Numbers per image including the state of the optimiser: the twelve numbers, then their first moments, second
  // moments, first bias corrections and second bias corrections.
  kAppearanceState = 60
};

UBS_FN int appearance_diagonal(int q) { return q == 0 || q == 5 || q == 10; }

// Returns the factor by which number q multiplies its input colour.
UBS_FN real appearance_factor(int q, real a) { return appearance_diagonal(q) ? ubs_real_exp(a) : a; }
// Returns d factor / d a.
UBS_FN real appearance_slope(int q, real a) { return appearance_diagonal(q) ? ubs_real_exp(a) : R(1.0); }
