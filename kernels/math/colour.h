// SPDX-License-Identifier: Apache-2.0
// The functions of this file compute the colour of a splat seen from a direction d, and its gradients (method.md 5.2).
// UBS_COLOUR selects one of three representations of the colour:
// - the raw rgb values, without dependence on the direction;
// - max(0, 1/2 + sum_k Y_k(d) f_k) with the real spherical harmonics Y_k up to degree 3, in the order and with the
//   signs of 3D Gaussian Splatting;
// - the constant harmonic plus spherical Beta lobes.
// The direction d is a unit vector. The gradient with respect to d is computed as if d could be any vector. splat.h
// multiplies it by the derivative of the normalisation, which projects it onto the sphere.
#pragma once

typedef struct {
  vreal e[16];  // the first UBS_SH_COUNT are used
} ShBasis;

UBS_FN ShBasis sh_basis(Vec3 d) {
  ShBasis y;
  y.e[0] = V(0.28209479177387814347);
  vreal dx = d.e[0], dy = d.e[1], dz = d.e[2];
  if (UBS_SH_COUNT > 1) {
    y.e[1] = V(-0.48860251190291992159) * dy;
    y.e[2] = V(0.48860251190291992159) * dz;
    y.e[3] = V(-0.48860251190291992159) * dx;
  }
  vreal xx = dx * dx, yy = dy * dy, zz = dz * dz;
  if (UBS_SH_COUNT > 4) {
    y.e[4] = V(1.0925484305920790705) * dx * dy;
    y.e[5] = V(-1.0925484305920790705) * dy * dz;
    y.e[6] = V(0.31539156525252000603) * (V(2.0) * zz - xx - yy);
    y.e[7] = V(-1.0925484305920790705) * dx * dz;
    y.e[8] = V(0.54627421529603953527) * (xx - yy);
  }
  if (UBS_SH_COUNT > 9) {
    y.e[9] = V(-0.59004358992664351035) * dy * (V(3.0) * xx - yy);
    y.e[10] = V(2.8906114426405540554) * dx * dy * dz;
    y.e[11] = V(-0.45704579946446573616) * dy * (V(4.0) * zz - xx - yy);
    y.e[12] = V(0.37317633259011539141) * dz * (V(2.0) * zz - V(3.0) * xx - V(3.0) * yy);
    y.e[13] = V(-0.45704579946446573616) * dx * (V(4.0) * zz - xx - yy);
    y.e[14] = V(1.4453057213202770277) * dz * (xx - yy);
    y.e[15] = V(-0.59004358992664351035) * dx * (xx - V(3.0) * yy);
  }
  return y;
}

// Returns the gradient of sum_k weight_k Y_k(d) with respect to d.
UBS_FN Vec3 sh_basis_vjp(Vec3 d, ShBasis weight) {
  Vec3 v;
  v.e[0] = V(0.0);
  v.e[1] = V(0.0);
  v.e[2] = V(0.0);
  if (UBS_SH_COUNT > 1) {
    vreal c1 = V(0.48860251190291992159);
    v.e[0] -= c1 * weight.e[3];
    v.e[1] -= c1 * weight.e[1];
    v.e[2] += c1 * weight.e[2];
  }
  vreal dx = d.e[0], dy = d.e[1], dz = d.e[2];
  if (UBS_SH_COUNT > 4) {
    vreal w4 = V(1.0925484305920790705) * weight.e[4], w5 = V(-1.0925484305920790705) * weight.e[5];
    vreal w6 = V(0.63078313050504001207) * weight.e[6], w7 = V(-1.0925484305920790705) * weight.e[7];
    vreal w8 = V(1.0925484305920790705) * weight.e[8];
    v.e[0] += w4 * dy - w6 * dx + w7 * dz + w8 * dx;
    v.e[1] += w4 * dx + w5 * dz - w6 * dy - w8 * dy;
    v.e[2] += w5 * dy + V(2.0) * w6 * dz + w7 * dx;
  }
  if (UBS_SH_COUNT > 9) {
    vreal xx = dx * dx, yy = dy * dy, zz = dz * dz;
    vreal w9 = V(-0.59004358992664351035) * weight.e[9], w10 = V(2.8906114426405540554) * weight.e[10];
    vreal w11 = V(-0.45704579946446573616) * weight.e[11], w12 = V(0.37317633259011539141) * weight.e[12];
    vreal w13 = V(-0.45704579946446573616) * weight.e[13], w14 = V(1.4453057213202770277) * weight.e[14];
    vreal w15 = V(-0.59004358992664351035) * weight.e[15];
    v.e[0] += V(6.0) * w9 * dx * dy + w10 * dy * dz - V(2.0) * w11 * dx * dy - V(6.0) * w12 * dx * dz +
              w13 * (V(4.0) * zz - V(3.0) * xx - yy) + V(2.0) * w14 * dx * dz + V(3.0) * w15 * (xx - yy);
    v.e[1] += V(3.0) * w9 * (xx - yy) + w10 * dx * dz + w11 * (V(4.0) * zz - xx - V(3.0) * yy) -
              V(6.0) * w12 * dy * dz - V(2.0) * w13 * dx * dy - V(2.0) * w14 * dy * dz - V(6.0) * w15 * dx * dy;
    v.e[2] += w10 * dx * dy + V(8.0) * w11 * dy * dz + w12 * (V(6.0) * zz - V(3.0) * xx - V(3.0) * yy) +
              V(8.0) * w13 * dx * dz + w14 * (xx - yy);
  }
  return v;
}

// Returns the row of coefficient k of channel c. The constant terms of all channels come first, then the other
// coefficients channel by channel.
UBS_FN int sh_row(int c, int k) {
  return kRowRgb + (k == 0 ? c : 3 + c * (UBS_SH_COUNT - 1) + (k > 0 ? k - 1 : 0));
}

// Returns the row of a field of lobe l. The fields are raw red, green and blue, the angles theta and phi of the axis,
// and the raw beta.
UBS_FN int lobe_row(int field, int l) { return kRowRgb + 3 + field * UBS_LOBES + l; }

// Lobe is a spherical Beta lobe, seen from the direction d. Where u = d . m is positive, the lobe adds
// softplus_k(raw colour) u^p to the colour. m is the axis of the lobe, and p = 4 exp(beta).
typedef struct {
  Vec3 m, m_theta, m_phi;  // axis, and its derivatives with respect to the angles theta and phi
  vreal log_value;         // p ln u
  vreal value, slope;      // u^p, and its derivative with respect to u
} Lobe;

UBS_FN Lobe lobe_seen(vreal theta, vreal phi, vreal raw_beta, Vec3 d) {
  Lobe b;
  vreal st = ubs_sin(theta), ct = ubs_cos(theta), sp = ubs_sin(phi), cp = ubs_cos(phi);
  b.m.e[0] = st * cp;
  b.m.e[1] = st * sp;
  b.m.e[2] = ct;
  b.m_theta.e[0] = ct * cp;
  b.m_theta.e[1] = ct * sp;
  b.m_theta.e[2] = -st;
  b.m_phi.e[0] = -b.m.e[1];
  b.m_phi.e[1] = b.m.e[0];
  b.m_phi.e[2] = V(0.0);
  // For unit vectors 1 - u = |d - m|^2 / 2. For a sharp lobe, 1 - u is so small that computing it from the
  // scalar product d . m would give only rounding errors.
  vreal x = d.e[0] - b.m.e[0], y = d.e[1] - b.m.e[1], z = d.e[2] - b.m.e[2];
  vreal r = V(0.5) * (x * x + y * y + z * z);
  vmask lit = r < V(1.0);
  r = lit ? r : V(0.0);
  vreal p = V(4.0) * ubs_exp(raw_beta < (vreal)(UBS_BETA_RAW_MAX) ? raw_beta : (vreal)(UBS_BETA_RAW_MAX));
  vreal u = V(1.0) - r;
  b.log_value = p * ubs_log2_1m(r) * (vreal)(UBS_LN2);
  b.value = lit ? ubs_exp(b.log_value) : V(0.0);
  b.slope = p * b.value / (u > (vreal)(UBS_RIM) ? u : (vreal)(UBS_RIM));
  return b;
}

// These functions compute softplus_k, the softplus function with the sharpness k = 10 ln 2, and its derivative. A raw
// colour of 0 gives 0.1.
#define UBS_LOBE_SHARPNESS V(6.9314718055994530942)
UBS_FN vreal lobe_colour(vreal raw) { return ubs_softplus(UBS_LOBE_SHARPNESS * raw) / UBS_LOBE_SHARPNESS; }
UBS_FN vreal lobe_colour_slope(vreal raw) { return ubs_sigmoid(UBS_LOBE_SHARPNESS * raw); }
