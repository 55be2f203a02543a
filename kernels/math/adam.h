// SPDX-License-Identifier: Apache-2.0
// Computes one Adam step of one parameter (method.md 4.2) and the gradients of the parameter penalties (method.md 4.1).
// All functions work on raw parameters, that is, on parameters before their activation function.
#pragma once

typedef struct {
  vreal param, moment1, moment2;
} AdamState;

// Constants that are the same for all parameters of a step. The host computes the bias corrections in double precision,
// because in single precision 1 - 0.999^t loses half of its digits at t = 1.
typedef struct {
  real beta1, beta2, epsilon;
  real inverse_bias1;       // 1 / (1 - beta1^t)
  real inverse_sqrt_bias2;  // 1 / sqrt(1 - beta2^t)
} AdamConstants;

// Returns the state after one step. epsilon is added to sqrt(v_hat), where v_hat is the second moment v with its bias
// correction, as in PyTorch. It prevents 0/0 for a zero gradient. Second moments below the normal range of single
// precision may be flushed to zero by the device without an effect on the step: for v < 1.2e-38, sqrt(v_hat) is at most
// 3.5e-18 in the first step and less in later steps, which is far below epsilon = 1e-15.
UBS_FN AdamState adam_update(AdamState s, vreal gradient, real learning_rate, AdamConstants k) {
  s.moment1 = k.beta1 * s.moment1 + (R(1.0) - k.beta1) * gradient;
  s.moment2 = k.beta2 * s.moment2 + (R(1.0) - k.beta2) * gradient * gradient;
  vreal size = ubs_sqrt(s.moment2) * k.inverse_sqrt_bias2 + k.epsilon;
  s.param = s.param - learning_rate * k.inverse_bias1 * s.moment1 / size;
  return s;
}

// Returns whether any of the three values is NaN or infinite. The product of such a value and 0 is NaN.
UBS_FN vmask adam_not_finite(AdamState s) {
  vreal zero = s.param * R(0.0) + s.moment1 * R(0.0) + s.moment2 * R(0.0);
  return zero != zero;
}

// Returns the parameter row that belongs to a row of gradients and moments. Gradients and moments have no rows for
// parameter groups that are not trained (UBS_FROZEN).
#define UBS_SKIP_FROZEN(g, first, last, row) \
  if ((UBS_FROZEN >> (g)&1) && row >= (first)) row += (last) - (first);
UBS_FN int adam_param_row(int row) {
  UBS_GROUPS(UBS_SKIP_FROZEN, row)
  return row;
}

// Returns the derivative of weight * sigmoid(raw) with respect to raw. The slope o (1 - o) of the sigmoid o is computed
// as sigmoid(raw) sigmoid(-raw), which avoids cancellation.
UBS_FN vreal opacity_penalty_vjp(vreal raw_opacity, real weight) {
  return weight * ubs_sigmoid(raw_opacity) * ubs_sigmoid(-raw_opacity);
}

// Returns the derivative of weight * softplus(raw) with respect to raw.
UBS_FN vreal scale_penalty_vjp(vreal raw_scale, real weight) { return weight * ubs_sigmoid(raw_scale); }

// has_penalty() returns whether a row of parameters has a penalty. penalty_vjp() returns the gradient of the penalty
// with respect to the raw parameter. The weights are already divided by the number of splats.
UBS_FN int has_penalty(int row, PenaltyWeights w) {
  if (row == kRowOpacity) return w.opacity != R(0.0);
  if (row >= kRowScale && row < kRowScale + 3) return w.scale != R(0.0);
  return 0;
}
UBS_FN vreal penalty_vjp(int row, vreal raw, PenaltyWeights w) {
  if (row == kRowOpacity) return opacity_penalty_vjp(raw, w.opacity);
  return scale_penalty_vjp(raw, w.scale);
}
