// SPDX-License-Identifier: Apache-2.0
// One Adam step (method.md 4.2) of one parameter, and the gradients of the parameter penalties
// (method.md 4.1). Both take raw parameters, before activation.
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

// Returns the state after one step. epsilon is added to sqrt(v_hat), as in PyTorch, and prevents 0/0 for a zero
// gradient. Moments below the normal range of single precision have no effect, even if the device flushes them to zero:
// v < 1.2e-38 means sqrt(v_hat) <= 3.5e-18 (t = 1) or 1.1e-19 (large t), compared with epsilon = 1e-15.
UBS_FN AdamState adam_update(AdamState s, vreal gradient, real learning_rate, AdamConstants k) {
  s.moment1 = k.beta1 * s.moment1 + (R(1.0) - k.beta1) * gradient;
  s.moment2 = k.beta2 * s.moment2 + (R(1.0) - k.beta2) * gradient * gradient;
  vreal size = ubs_sqrt(s.moment2) * k.inverse_sqrt_bias2 + k.epsilon;
  s.param = s.param - learning_rate * k.inverse_bias1 * s.moment1 / size;
  return s;
}

// Returns whether any of the three values is NaN or infinite; multiplied by 0, such a value gives NaN.
UBS_FN vmask adam_not_finite(AdamState s) {
  vreal zero = s.param * R(0.0) + s.moment1 * R(0.0) + s.moment2 * R(0.0);
  return zero != zero;
}

// Returns the parameter row that belongs to a row of gradients and moments. The latter have no rows for parameter
// groups that are not trained (UBS_FROZEN).
#define UBS_SKIP_FROZEN(g, first, last, row) \
  if ((UBS_FROZEN >> (g)&1) && row >= (first)) row += (last) - (first);
UBS_FN int adam_param_row(int row) {
  UBS_GROUPS(UBS_SKIP_FROZEN, row)
  return row;
}

// Returns d/d raw of weight * sigmoid(raw). The slope o (1 - o) is computed as sigmoid(raw) sigmoid(-raw), without
// cancellation.
UBS_FN vreal opacity_penalty_vjp(vreal raw_opacity, real weight) {
  return weight * ubs_sigmoid(raw_opacity) * ubs_sigmoid(-raw_opacity);
}

// Returns d/d raw of weight * softplus(raw).
UBS_FN vreal scale_penalty_vjp(vreal raw_scale, real weight) { return weight * ubs_sigmoid(raw_scale); }

// These functions return whether a row of parameters has a penalty, and the gradient of the penalty with respect to the
// raw parameter. The weights are those of one splat.
UBS_FN int has_penalty(int row, PenaltyWeights w) {
  if (row == kRowOpacity) return w.opacity != R(0.0);
  if (row >= kRowScale && row < kRowScale + 3) return w.scale != R(0.0);
  return 0;
}
UBS_FN vreal penalty_vjp(int row, vreal raw, PenaltyWeights w) {
  if (row == kRowOpacity) return opacity_penalty_vjp(raw, w.opacity);
  return scale_penalty_vjp(raw, w.scale);
}
