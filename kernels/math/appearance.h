// SPDX-License-Identifier: Apache-2.0
// Maps the colours x of a rendered image to the colours y of one photograph, to correct exposure and white balance
// (method.md 4.9). Each image has twelve numbers a, which form three rows of four:
//   y_c = exp(a_cc) x_c + sum over k != c of a_ck x_k + a_c3.
// If all numbers are 0, y = x. With the setting `appearance gain`, only the diagonal numbers a_cc are trained, and the
// other numbers stay 0.
#pragma once

enum {
  kAppearanceSize = 12,   // numbers per image
  // Numbers per image including the state of the optimiser: the twelve numbers, then their first moments, second
  // moments, first bias corrections and second bias corrections.
  kAppearanceState = 60
};

// Returns whether number q is on the diagonal.
UBS_FN int appearance_diagonal(int q) { return q == 0 || q == 5 || q == 10; }

// Returns the factor of an input colour (or the added term) in the formula above that number q with the value a gives.
UBS_FN real appearance_factor(int q, real a) { return appearance_diagonal(q) ? ubs_real_exp(a) : a; }
// Returns the derivative of this factor with respect to a.
UBS_FN real appearance_slope(int q, real a) { return appearance_diagonal(q) ? ubs_real_exp(a) : R(1.0); }
