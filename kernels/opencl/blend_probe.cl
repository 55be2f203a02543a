// SPDX-License-Identifier: Apache-2.0
// Blending at chosen points, forward and backward, by the formulas of math/blend.h as the rasterisers use them:
// what `ubs sweep` measures instead of pixels on a grid. One work-item is one stack of splats, front to back, seen at
// UBS_PROBE_POINTS points; the sums over the points are in the order of the points.

#define UBS_PROBE_PARTS (UBS_PROBE_POINTS / UBS_VW)

UBS_FN BlendSplat load_probe_splat(__global const float* record) {
  BlendSplat s;
  s.l00 = record[UBS_S_L00];
  s.l01 = record[UBS_S_L01];
  s.l11 = record[UBS_S_L11];
  s.opacity = record[UBS_S_OPACITY];
  s.beta = record[UBS_S_BETA];
  s.r = record[UBS_S_R];
  s.g = record[UBS_S_G];
  s.b = record[UBS_S_B];
  return s;
}

UBS_FN float sum_of_lanes(vreal v) {
  float lanes[UBS_VW], sum = 0.0f;
  UBS_STORE(v, lanes);
  for (int i = 0; i < UBS_VW; ++i) sum += lanes[i];
  return sum;
}

UBS_FN void store_probe_gradient(BlendSums v, BlendSplat s, __global float* to) {
  float hp = sum_of_lanes(v.hp), hq = sum_of_lanes(v.hq);
  float hpp = sum_of_lanes(v.hpp), hpq = sum_of_lanes(v.hpq), hqq = sum_of_lanes(v.hqq);
#ifdef UBS_NAIVE_BLEND_H
  to[UBS_G_X] = 2.0f * (s.l00 * hp + s.l01 * hq);
  to[UBS_G_Y] = 2.0f * (s.l01 * hp + s.l11 * hq);
  to[UBS_G_W00] = hpp;
  to[UBS_G_W01] = 2.0f * hpq;
  to[UBS_G_W11] = hqq;
  to[UBS_G_BETA] = sum_of_lanes(v.log_beta);
#else
  BlendFactors f = blend_factors(s);
  to[UBS_G_X] = f.xp * hp;
  to[UBS_G_Y] = f.yp * hp + f.yq * hq;
  to[UBS_G_W00] = f.square * hpp;
  to[UBS_G_W01] = f.square * hpq;
  to[UBS_G_W11] = f.square * hqq;
  to[UBS_G_BETA] = UBS_LN2 * sum_of_lanes(v.log_beta);
#endif
  to[UBS_G_OPACITY] = sum_of_lanes(v.opacity);
  to[UBS_G_R] = sum_of_lanes(v.r);
  to[UBS_G_G] = sum_of_lanes(v.g);
  to[UBS_G_B] = sum_of_lanes(v.b);
}

// points: per stack x then y; image and v_image: per stack r, g, b; UBS_PROBE_POINTS values each.
__kernel void blend_probe(__global const float* records, uint stacks, uint layers, __global const float* points,
                          __global const float* v_image, __global float* image, __global float* v_records) {
  uint stack = (uint)get_global_id(0);
  if (stack >= stacks) return;
  records += (size_t)stack * layers * UBS_SPLAT_STRIDE;
  v_records += (size_t)stack * layers * UBS_GRAD_STRIDE;
  points += (size_t)stack * 2 * UBS_PROBE_POINTS;
  image += (size_t)stack * 3 * UBS_PROBE_POINTS;
  v_image += (size_t)stack * 3 * UBS_PROBE_POINTS;
  for (int part = 0; part < UBS_PROBE_PARTS; ++part) {
    vreal x = UBS_LOAD(points + part * UBS_VW), y = UBS_LOAD(points + UBS_PROBE_POINTS + part * UBS_VW);
    vreal open = V(1.0), r = V(0.0), g = V(0.0), b = V(0.0);
    for (uint k = 0; k < layers; ++k) {
      __global const float* record = records + k * UBS_SPLAT_STRIDE;
      BlendSplat s = load_probe_splat(record);
      BlendStep step = blend_step(blend_alpha(s, record[UBS_S_X] - x, record[UBS_S_Y] - y), open);
      r += step.weight * s.r;
      g += step.weight * s.g;
      b += step.weight * s.b;
      open = step.open;
    }
    UBS_STORE(r, image + part * UBS_VW);
    UBS_STORE(g, image + UBS_PROBE_POINTS + part * UBS_VW);
    UBS_STORE(b, image + 2 * UBS_PROBE_POINTS + part * UBS_VW);
  }
  vreal open[UBS_PROBE_PARTS], remaining[UBS_PROBE_PARTS];
  for (int part = 0; part < UBS_PROBE_PARTS; ++part) {
    open[part] = V(1.0);
    remaining[part] = V(0.0);
    for (int c = 0; c < 3; ++c)
      remaining[part] += UBS_LOAD(image + c * UBS_PROBE_POINTS + part * UBS_VW) *
                         UBS_LOAD(v_image + c * UBS_PROBE_POINTS + part * UBS_VW);
  }
  for (uint k = 0; k < layers; ++k) {
    __global const float* record = records + k * UBS_SPLAT_STRIDE;
    BlendSplat s = load_probe_splat(record);
    BlendSums sums = blend_no_sums();
    for (int part = 0; part < UBS_PROBE_PARTS; ++part) {
      vreal dx = record[UBS_S_X] - UBS_LOAD(points + part * UBS_VW);
      vreal dy = record[UBS_S_Y] - UBS_LOAD(points + UBS_PROBE_POINTS + part * UBS_VW);
      vreal v_r = UBS_LOAD(v_image + part * UBS_VW), v_g = UBS_LOAD(v_image + UBS_PROBE_POINTS + part * UBS_VW);
      vreal v_b = UBS_LOAD(v_image + 2 * UBS_PROBE_POINTS + part * UBS_VW);
      BlendAlpha a = blend_alpha(s, dx, dy);
      BlendStep step = blend_step(a, open[part]);
      remaining[part] = blend_remaining(s, step, remaining[part], v_r, v_g, v_b);
      sums = blend_vjp(sums, s, a, step, open[part], remaining[part], v_r, v_g, v_b);
      open[part] = step.open;
    }
    store_probe_gradient(sums, s, v_records + k * UBS_GRAD_STRIDE);
  }
}
