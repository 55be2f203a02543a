// SPDX-License-Identifier: Apache-2.0
// Conditioning and projection fused, forward and backward: one work-item takes UBS_VW consecutive
// splats through kernels/math/splat.h. Parameters are read in rows, records are written per splat.

UBS_FN CameraView load_camera(UBS_GLOBAL const real* c, real near_plane, real far_plane, real eps2d) {
  CameraView cam;
  UBS_UNROLL for (int i = 0; i < 9; ++i) cam.rotation[i / 3][i % 3] = c[UBS_CAM_ROTATION + i];
  UBS_UNROLL for (int i = 0; i < 3; ++i) cam.centre[i] = c[UBS_CAM_CENTRE + i];
  UBS_UNROLL for (int i = 0; i < UBS_CAM_QUERY_MAX; ++i) cam.query[i] = c[UBS_CAM_QUERY + i];
  cam.fx = c[UBS_CAM_FOCAL];
  cam.fy = c[UBS_CAM_FOCAL + 1];
  cam.cx = c[UBS_CAM_PRINCIPAL];
  cam.cy = c[UBS_CAM_PRINCIPAL + 1];
  cam.width = c[UBS_CAM_SIZE];
  cam.height = c[UBS_CAM_SIZE + 1];
  cam.near_plane = near_plane;
  cam.far_plane = far_plane;
  cam.eps2d = eps2d;
  return cam;
}

UBS_FN SplatRaw load_splats(UBS_GLOBAL const real* params, uint stride, uint first) {
  SplatRaw raw;
  UBS_UNROLL for (int k = 0; k < UBS_PARAMS; ++k) raw.e[k] = UBS_LOAD(params + (size_t)k * stride + first);
  return raw;
}

// First and last pixel, in 0 .. size-1, whose centre lies in middle +- half; first > last when none.
typedef struct {
  vreal first, last;
} PixelRange;

UBS_FN PixelRange pixel_range(vreal middle, vreal half_extent, real size) {
  PixelRange range;
  range.first = ubs_ceil(middle - half_extent - V(0.5));
  range.last = ubs_floor(middle + half_extent - V(0.5));
  range.first = range.first > V(0.0) ? range.first : V(0.0);
  range.last = range.last < (vreal)(size - R(1.0)) ? range.last : (vreal)(size - R(1.0));
  return range;
}

UBS_KERNEL void project_forward(UBS_GLOBAL const real* params, uint count, uint stride,
                                UBS_GLOBAL const real* cameras, uint camera, real near_plane, real far_plane,
                                real eps2d, UBS_GLOBAL real* records, UBS_GLOBAL uint* depth_keys,
                                UBS_GLOBAL uint* tile_rects, UBS_GLOBAL uint* tile_counts) {
  uint first = UBS_GLOBAL_ID(0) * UBS_VW;
  if (first >= count) return;
  CameraView cam = load_camera(cameras + (size_t)camera * UBS_CAMERA_STRIDE, near_plane, far_plane, eps2d);
  SplatRaw raw = load_splats(params, stride, first);
  SplatImage splat = splat_image(raw, splat_state(cam, raw));
  PixelRange px = pixel_range(splat.x, splat.hx, cam.width);
  PixelRange py = pixel_range(splat.y, splat.hy, cam.height);
  vmask drawn = splat.valid & (px.first <= px.last) & (py.first <= py.last);

  real record[UBS_SPLAT_STRIDE][UBS_VW];
  UBS_STORE(splat.x, record[UBS_S_X]);
  UBS_STORE(splat.y, record[UBS_S_Y]);
  UBS_STORE(splat.conic.l00, record[UBS_S_L00]);
  UBS_STORE(splat.conic.l01, record[UBS_S_L01]);
  UBS_STORE(splat.conic.l11, record[UBS_S_L11]);
  UBS_STORE(splat.opacity, record[UBS_S_OPACITY]);
  UBS_STORE(splat.beta, record[UBS_S_BETA]);
  UBS_STORE(splat.r, record[UBS_S_R]);
  UBS_STORE(splat.g, record[UBS_S_G]);
  UBS_STORE(splat.b, record[UBS_S_B]);
  UBS_STORE(splat.hx, record[UBS_S_HX]);
  UBS_STORE(splat.hy, record[UBS_S_HY]);
  UBS_STORE(splat.depth, record[UBS_S_DEPTH]);
  real is_drawn[UBS_VW], x0[UBS_VW], x1[UBS_VW], y0[UBS_VW], y1[UBS_VW];
  UBS_STORE((drawn ? V(1.0) : V(0.0)), is_drawn);
  UBS_STORE(px.first, x0);
  UBS_STORE(px.last, x1);
  UBS_STORE(py.first, y0);
  UBS_STORE(py.last, y1);

  for (uint lane = 0; lane < UBS_VW && first + lane < count; ++lane) {
    uint i = first + lane;
    if (is_drawn[lane] == R(0.0)) {
      depth_keys[i] = UBS_KEY_CULLED;
      tile_counts[i] = 0;
      continue;
    }
    UBS_GLOBAL real* out = records + (size_t)i * UBS_SPLAT_STRIDE;
    UBS_UNROLL for (int k = 0; k <= UBS_S_DEPTH; ++k) out[k] = record[k][lane];
    uint tx0 = (uint)x0[lane] / UBS_TILE, tx1 = (uint)x1[lane] / UBS_TILE;
    uint ty0 = (uint)y0[lane] / UBS_TILE, ty1 = (uint)y1[lane] / UBS_TILE;
    depth_keys[i] = ubs_float_bits((float)record[UBS_S_DEPTH][lane]);
    tile_rects[2 * (size_t)i] = tx0 | (tx1 << 16);
    tile_rects[2 * (size_t)i + 1] = ty0 | (ty1 << 16);
    tile_counts[i] = (tx1 - tx0 + 1) * (ty1 - ty0 + 1);
  }
}

UBS_KERNEL void project_backward(UBS_GLOBAL const real* params, uint count, uint stride,
                                 UBS_GLOBAL const real* cameras, uint camera, real near_plane, real far_plane,
                                 real eps2d, UBS_GLOBAL const uint* tile_counts,
                                 UBS_GLOBAL const real* v_records, UBS_GLOBAL real* v_params, uint accumulate) {
  uint first = UBS_GLOBAL_ID(0) * UBS_VW;
  if (first >= count) return;
  real v[UBS_G_B + 1][UBS_VW];
  for (uint lane = 0; lane < UBS_VW; ++lane) {
    uint i = first + lane;
    uint drawn = i < count && tile_counts[i] != 0;
    UBS_UNROLL for (int k = 0; k <= UBS_G_B; ++k)
      v[k][lane] = drawn ? v_records[(size_t)i * UBS_GRAD_STRIDE + k] : R(0.0);
  }
  SplatImageVjp in;
  in.x = UBS_LOAD(v[UBS_G_X]);
  in.y = UBS_LOAD(v[UBS_G_Y]);
  in.conic.a = UBS_LOAD(v[UBS_G_Q00]);
  in.conic.b = UBS_LOAD(v[UBS_G_Q01]);
  in.conic.c = UBS_LOAD(v[UBS_G_Q11]);
  in.opacity = UBS_LOAD(v[UBS_G_OPACITY]);
  in.beta = UBS_LOAD(v[UBS_G_BETA]);
  in.r = UBS_LOAD(v[UBS_G_R]);
  in.g = UBS_LOAD(v[UBS_G_G]);
  in.b = UBS_LOAD(v[UBS_G_B]);
  vmask contributing = UBS_LOAD(v[0]) != V(0.0);
  UBS_UNROLL for (int k = 1; k <= UBS_G_B; ++k) contributing = contributing | (UBS_LOAD(v[k]) != V(0.0));
  if (!ubs_any(contributing)) {
    if (!accumulate)
      UBS_UNROLL for (int k = 0; k < UBS_PARAMS; ++k) UBS_STORE(V(0.0), v_params + (size_t)k * stride + first);
    return;
  }
  CameraView cam = load_camera(cameras + (size_t)camera * UBS_CAMERA_STRIDE, near_plane, far_plane, eps2d);
  SplatRaw raw = load_splats(params, stride, first);
  SplatRaw out = splat_vjp(cam, raw, in);
  UBS_UNROLL for (int k = 0; k < UBS_PARAMS; ++k) {
    UBS_GLOBAL real* row = v_params + (size_t)k * stride + first;
    // A splat without contribution has an exactly zero gradient, whatever its parameters are.
    vreal value = contributing ? out.e[k] : V(0.0);
    if (accumulate) value += UBS_LOAD(row);
    UBS_STORE(value, row);
  }
}
