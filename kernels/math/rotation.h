// SPDX-License-Identifier: Apache-2.0
// Computes the spatial "rotation" R from its raw parameters, and the gradient of the parameters (method.md 2.1, 3.4).
// UBS_ROT_MODE selects one of five representations. R is computed from a quaternion, or from a skew matrix A with the
// axis omega. In the second case, R = I + f(t) A + g(t) A^2 with t = |omega|^2, and the functions f and g are
//   taylor1:  f = 1, g = 0
//   taylor2:  f = 1, g = 1/2
//   cayley:   f = g = 2 / (1 + t)
//   exp:      f = sin(sqrt t)/sqrt t, g = (1 - cos(sqrt t))/t (formula of Rodrigues).
// R is orthogonal only with cayley, exp and quaternions. With taylor1, det R = 1 + t.
#pragma once

typedef struct {
  vreal e[3];
} Vec3;

typedef struct {
  vreal e[3][3];
} Mat3;

// The raw parameters are a0, a1 and a2, which are the entries of the upper triangle of A, or a quaternion w, x, y, z of
// any length.
#if UBS_ROT_MODE == UBS_ROT_QUATERNION
enum { kRotationParams = 4 };
#else
enum { kRotationParams = 3 };
#endif

typedef struct {
  vreal e[kRotationParams];
} RotationRaw;

#if UBS_ROT_MODE == UBS_ROT_QUATERNION

// A quaternion that is shorter than this is divided by this length instead of its own. As the length of a quaternion
// approaches 0, R then approaches I.
#define UBS_QUATERNION_MIN R(1e-12)

UBS_FN vreal quaternion_length(RotationRaw raw) {
  vreal length = ubs_sqrt(raw.e[0] * raw.e[0] + raw.e[1] * raw.e[1] + raw.e[2] * raw.e[2] + raw.e[3] * raw.e[3]);
  return length > (vreal)(UBS_QUATERNION_MIN) ? length : (vreal)(UBS_QUATERNION_MIN);
}

UBS_FN Mat3 rotation_matrix(RotationRaw raw) {
  vreal inverse = V(1.0) / quaternion_length(raw);
  vreal w = raw.e[0] * inverse, x = raw.e[1] * inverse, y = raw.e[2] * inverse, z = raw.e[3] * inverse;
  Mat3 r;
  r.e[0][0] = V(1.0) - V(2.0) * (y * y + z * z);
  r.e[0][1] = V(2.0) * (x * y - w * z);
  r.e[0][2] = V(2.0) * (x * z + w * y);
  r.e[1][0] = V(2.0) * (x * y + w * z);
  r.e[1][1] = V(1.0) - V(2.0) * (x * x + z * z);
  r.e[1][2] = V(2.0) * (y * z - w * x);
  r.e[2][0] = V(2.0) * (x * z - w * y);
  r.e[2][1] = V(2.0) * (y * z + w * x);
  r.e[2][2] = V(1.0) - V(2.0) * (x * x + y * y);
  return r;
}

// Computes the gradient of the unit quaternion u, then that of its normalisation: v_q = (v_u - u (u . v_u)) / |q|.
UBS_FN RotationRaw rotation_vjp(RotationRaw raw, Mat3 v) {
  vreal inverse = V(1.0) / quaternion_length(raw);
  vreal w = raw.e[0] * inverse, x = raw.e[1] * inverse, y = raw.e[2] * inverse, z = raw.e[3] * inverse;
  vreal skew0 = v.e[2][1] - v.e[1][2], skew1 = v.e[0][2] - v.e[2][0], skew2 = v.e[1][0] - v.e[0][1];
  vreal sym01 = v.e[0][1] + v.e[1][0], sym02 = v.e[0][2] + v.e[2][0], sym12 = v.e[1][2] + v.e[2][1];
  vreal unit[4], grad[4];
  unit[0] = w;
  unit[1] = x;
  unit[2] = y;
  unit[3] = z;
  grad[0] = V(2.0) * (x * skew0 + y * skew1 + z * skew2);
  grad[1] = V(2.0) * (w * skew0 + y * sym01 + z * sym02 - V(2.0) * x * (v.e[1][1] + v.e[2][2]));
  grad[2] = V(2.0) * (w * skew1 + x * sym01 + z * sym12 - V(2.0) * y * (v.e[0][0] + v.e[2][2]));
  grad[3] = V(2.0) * (w * skew2 + x * sym02 + y * sym12 - V(2.0) * z * (v.e[0][0] + v.e[1][1]));
  vreal along = unit[0] * grad[0] + unit[1] * grad[1] + unit[2] * grad[2] + unit[3] * grad[3];
  RotationRaw out;
  UBS_UNROLL for (int i = 0; i < 4; ++i) out.e[i] = (grad[i] - unit[i] * along) * inverse;
  return out;
}

#else

UBS_FN Mat3 skew_matrix(RotationRaw raw) {
  Mat3 a;
  a.e[0][0] = V(0.0);
  a.e[0][1] = raw.e[0];
  a.e[0][2] = raw.e[1];
  a.e[1][0] = -raw.e[0];
  a.e[1][1] = V(0.0);
  a.e[1][2] = raw.e[2];
  a.e[2][0] = -raw.e[1];
  a.e[2][1] = -raw.e[2];
  a.e[2][2] = V(0.0);
  return a;
}

#if UBS_ROT_MODE == UBS_ROT_TAYLOR1

UBS_FN Mat3 rotation_matrix(RotationRaw raw) {
  Mat3 r = skew_matrix(raw);
  UBS_UNROLL for (int i = 0; i < 3; ++i) r.e[i][i] = V(1.0);
  return r;
}

// The gradient is computed together with that of the scales, in covariance.h.

#else

// RotationFactors holds the functions f and g, and their derivatives with respect to t.
typedef struct {
  vreal f, g, df, dg;
} RotationFactors;

UBS_FN RotationFactors rotation_factors(vreal t) {
  RotationFactors k;
  if (UBS_ROT_MODE == UBS_ROT_TAYLOR2) {
    k.f = V(1.0);
    k.g = V(0.5);
    k.df = V(0.0);
    k.dg = V(0.0);
    return k;
  }
  if (UBS_ROT_MODE == UBS_ROT_CAYLEY) {
    vreal inverse = V(1.0) / (V(1.0) + t);
    k.f = V(2.0) * inverse;
    k.g = k.f;
    k.df = V(-2.0) * inverse * inverse;
    k.dg = k.df;
    return k;
  }
  // For t below 1 the closed formulas lose digits by cancellation, and the derivatives lose more of them the smaller t
  // is. Therefore the series f = sum (-t)^k / (2k+1)! and g = sum (-t)^k / (2k+2)! are used for t < 1. With nine terms
  // they have the accuracy of double precision.
  const real odd[9] = {R(1.0),
                       R(0.16666666666666666667),
                       R(0.0083333333333333333333),
                       R(1.9841269841269841270e-4),
                       R(2.7557319223985890653e-6),
                       R(2.5052108385441718775e-8),
                       R(1.6059043836821614599e-10),
                       R(7.6471637318198164759e-13),
                       R(2.8114572543455207632e-15)};
  const real even[9] = {R(0.5),
                        R(0.041666666666666666667),
                        R(0.0013888888888888888889),
                        R(2.4801587301587301587e-5),
                        R(2.7557319223985890653e-7),
                        R(2.0876756987868098979e-9),
                        R(1.1470745597729724714e-11),
                        R(4.7794773323873852974e-14),
                        R(1.5619206968586226462e-16)};
  vmask small = t < V(1.0);
  vreal s = small ? -t : V(0.0);
  vreal f = V(0.0), g = V(0.0), df = V(0.0), dg = V(0.0);
  UBS_UNROLL for (int n = 8; n >= 0; --n) {
    f = f * s + odd[n];
    g = g * s + even[n];
  }
  UBS_UNROLL for (int n = 8; n >= 1; --n) {
    df = df * s - (real)n * odd[n];
    dg = dg * s - (real)n * even[n];
  }
  vreal safe = small ? V(1.0) : t;
  vreal angle = ubs_sqrt(safe), half_sine = ubs_sin(V(0.5) * angle);
  vreal f_closed = ubs_sin(angle) / angle, g_closed = V(2.0) * half_sine * half_sine / safe;
  k.f = small ? f : f_closed;
  k.g = small ? g : g_closed;
  k.df = small ? df : V(0.5) * (ubs_cos(angle) - f_closed) / safe;
  k.dg = small ? dg : (V(0.5) * f_closed - g_closed) / safe;
  return k;
}

UBS_FN vreal skew_square(RotationRaw raw) {
  return raw.e[0] * raw.e[0] + raw.e[1] * raw.e[1] + raw.e[2] * raw.e[2];
}

UBS_FN Mat3 rotation_matrix(RotationRaw raw) {
  Mat3 a = skew_matrix(raw), r;
  RotationFactors k = rotation_factors(skew_square(raw));
  UBS_UNROLL for (int i = 0; i < 3; ++i)
    UBS_UNROLL for (int j = 0; j < 3; ++j) {
      vreal square = a.e[i][0] * a.e[0][j] + a.e[i][1] * a.e[1][j] + a.e[i][2] * a.e[2][j];
      r.e[i][j] = (i == j ? V(1.0) : V(0.0)) + k.f * a.e[i][j] + k.g * square;
    }
  return r;
}

// Returns the gradient of the raw parameters from v, the gradient of R. The gradients of A and t are
// v_A = f v + g (v A^T + A^T v) and v_t = f' <v, A> + g' <v, A^2>. t is the sum of the squares of the parameters.
UBS_FN RotationRaw rotation_vjp(RotationRaw raw, Mat3 v) {
  Mat3 a = skew_matrix(raw), v_a;
  RotationFactors k = rotation_factors(skew_square(raw));
  vreal v_t = V(0.0);
  UBS_UNROLL for (int i = 0; i < 3; ++i)
    UBS_UNROLL for (int j = 0; j < 3; ++j) {
      vreal square = V(0.0), turned = V(0.0);
      UBS_UNROLL for (int n = 0; n < 3; ++n) {
        square += a.e[i][n] * a.e[n][j];
        turned += v.e[i][n] * a.e[j][n] + a.e[n][i] * v.e[n][j];
      }
      v_a.e[i][j] = k.f * v.e[i][j] + k.g * turned;
      v_t += v.e[i][j] * (k.df * a.e[i][j] + k.dg * square);
    }
  RotationRaw out;
  out.e[0] = v_a.e[0][1] - v_a.e[1][0] + V(2.0) * raw.e[0] * v_t;
  out.e[1] = v_a.e[0][2] - v_a.e[2][0] + V(2.0) * raw.e[1] * v_t;
  out.e[2] = v_a.e[1][2] - v_a.e[2][1] + V(2.0) * raw.e[2] * v_t;
  return out;
}

#endif
#endif
