// SPDX-License-Identifier: Apache-2.0
// This file contains the kernels project_forward and project_backward. Each of them does the conditioning and the
// projection of splats, or computes their derivatives, in one pass. One work-item processes one or several blocks of
// UBS_VW consecutive splats with the functions of kernels/math/splat.h. Parameters are stored row by row, with one row
// for each parameter of all splats; records are stored splat by splat.

// SplatsInView holds the arguments that all kernels of this file have in common. Splat i has record first_record + i,
// because groups of splats with different numbers of dimensions share one buffer of records.
typedef struct {
  UBS_GLOBAL const real* params;
  uint count, stride, first_record;
  UBS_GLOBAL const real* cameras;
  uint camera;
  real near_plane, far_plane, eps2d;
} SplatsInView;

UBS_FN CameraView load_camera(SplatsInView view) {
  UBS_GLOBAL const real* c = view.cameras + (size_t)view.camera * kCameraStride;
  CameraView cam;
  UBS_UNROLL for (int i = 0; i < 9; ++i) cam.rotation[i / 3][i % 3] = c[kCameraRotation + i];
  UBS_UNROLL for (int i = 0; i < 3; ++i) cam.centre[i] = c[kCameraCentre + i];
  UBS_UNROLL for (int i = 0; i < kCameraQueryMax; ++i) cam.query[i] = c[kCameraQuery + i];
  cam.fx = c[kCameraFocal];
  cam.fy = c[kCameraFocal + 1];
  cam.cx = c[kCameraPrincipal];
  cam.cy = c[kCameraPrincipal + 1];
  cam.width = c[kCameraSize];
  cam.height = c[kCameraSize + 1];
  cam.near_plane = view.near_plane;
  cam.far_plane = view.far_plane;
  cam.eps2d = view.eps2d;
  return cam;
}

#ifndef UBS_PREFETCH_AHEAD
#define UBS_PREFETCH_AHEAD 1  // distance in work-items; a prefetch past the end of a buffer is harmless
#endif

// Prefetches the records of a later work-item. `records` points to those of the current work-item. A record has `words`
// reals and is one cache line.
#define UBS_PREFETCH_RECORDS(prefetch, records, words)                    \
  UBS_UNROLL for (int lane = 0; lane < UBS_VW; ++lane) {                  \
    prefetch((records) + (UBS_PREFETCH_AHEAD * UBS_VW + lane) * (words)); \
  }

// Loads the parameters of UBS_VW splats and prefetches those of a later work-item. `backward` is a constant that
// selects the cache level of the prefetch. Prefetching into the second-level cache makes the backward kernel and
// learn.cl 7 to 12 % faster, but the forward kernel 3 % slower (docs/results/2026-11-23-before-after.md).
UBS_FN SplatRaw load_splats(SplatsInView view, uint first, int backward) {
#if UBS_GAUSSIAN_ARRAYS
  (void)backward;
  return load_gaussians(*(UBS_GLOBAL const GaussianArrays*)view.params, first, view.count);
#else
  SplatRaw raw;
  UBS_UNROLL for (int k = 0; k < kRowCount; ++k) {
    UBS_GLOBAL const real* row = view.params + (size_t)k * view.stride + first;
    if (backward) {
      UBS_PREFETCH_FAR(row + UBS_PREFETCH_AHEAD * UBS_VW);
    } else {
      UBS_PREFETCH(row + UBS_PREFETCH_AHEAD * UBS_VW);
    }
    raw.e[k] = UBS_LOAD(row);
  }
  return raw;
#endif
}

// Returns whether the length of the vector of raw parameters is at most UBS_RAW_MAX. This is false if a parameter is
// NaN or infinite. The sum of squares costs only one instruction per parameter. It is divided into two sums, so that
// consecutive instructions do not wait for each other.
UBS_FN vmask within_raw_range(SplatRaw raw) {
  vreal even = V(0.0), odd = V(0.0);
  UBS_UNROLL for (int k = 0; k + 1 < kRowCount; k += 2) {
    even += raw.e[k] * raw.e[k];
    odd += raw.e[k + 1] * raw.e[k + 1];
  }
  if (kRowCount % 2 != 0) even += raw.e[kRowCount - 1] * raw.e[kRowCount - 1];
  return even + odd <= (vreal)(UBS_RAW_MAX * UBS_RAW_MAX);
}

// PixelRange holds the first and the last of the pixels 0 to size - 1 whose centres are within half_extent of the
// middle. If there is no such pixel, first > last.
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

// Returns whether any of the splats needs the computations for thin splats (splat_thin()).
UBS_FN int any_thin(SplatRaw raw) {
  ThinSplats thin = splat_thin(raw);
  return ubs_any_lane(thin.lifted | thin.coupled);
}

#ifndef UBS_CAMERA_GRAD
// Projects the splats and writes their results. `thin` is passed to splat_state(). `to` is the index of the first
// record.
UBS_FN void project_block(CameraView cam, SplatRaw raw, ViewRay sight, int thin, uint to, UBS_GLOBAL real* records,
                          UBS_GLOBAL uint* depth_keys, UBS_GLOBAL uint* tile_rects,
                          UBS_GLOBAL uint* tile_counts) {
  // With one lane, as on GPUs, the range is checked first, because a later check would keep all parameters in
  // registers. With several lanes, the parameters are in memory anyway. Then it is 4 % faster to check the range after
  // the projection, because the check fills the time in which other instructions wait.
  vmask within;
  if (UBS_VW == 1) within = within_raw_range(raw);
  SplatImage splat = splat_image(raw, splat_state(cam, raw, sight, thin));
  if (UBS_VW > 1) within = within_raw_range(raw);
  PixelRange px = pixel_range(splat.x, splat.hx, cam.width);
  PixelRange py = pixel_range(splat.y, splat.hy, cam.height);
  vmask drawn = splat.valid & within & (px.first <= px.last) & (py.first <= py.last);

  Records out;
  UBS_UNROLL for (int k = 0; k < kSplatStride; ++k) out.field[k] = V(0.0);
  out.field[kSplatX] = splat.x;
  out.field[kSplatY] = splat.y;
  out.field[kSplatL00] = splat.conic.l00;
  out.field[kSplatL01] = splat.conic.l01;
  out.field[kSplatL11] = splat.conic.l11;
  out.field[kSplatOpacity] = splat.opacity;
  out.field[kSplatBeta] = splat.beta;
  out.field[kSplatR] = splat.r;
  out.field[kSplatG] = splat.g;
  out.field[kSplatB] = splat.b;
  out.field[kSplatHx] = splat.hx;
  out.field[kSplatHy] = splat.hy;
  out.field[kSplatDepth] = splat.depth;
  if (UBS_OPACITY_EXTENTS) out.field[kSplatReach] = splat.reach;
  UBS_GLOBAL real* record = records + (size_t)to * kSplatStride;
  UBS_PREFETCH_RECORDS(UBS_PREFETCH_WRITE, record, kSplatStride)
  store_records(out, record);

  vreal zero = V(0.0);
  vuint tx0 = UBS_TO_VUINT((drawn ? px.first : zero)) / kTileSide;
  vuint tx1 = UBS_TO_VUINT((drawn ? px.last : zero)) / kTileSide;
  vuint ty0 = UBS_TO_VUINT((drawn ? py.first : zero)) / kTileSide;
  vuint ty1 = UBS_TO_VUINT((drawn ? py.last : zero)) / kTileSide;
  vuint tiles = (tx1 - tx0 + 1) * (ty1 - ty0 + 1);
  UBS_STORE((drawn ? UBS_FLOAT_BITS(splat.depth) : (vuint)(UBS_KEY_CULLED)), depth_keys + to);
  UBS_STORE((drawn ? tiles : (vuint)(0)), tile_counts + to);
  store_pairs(tx0 | (tx1 << 16), ty0 | (ty1 << 16), tile_rects + 2 * (size_t)to);
}

// An item is a block of UBS_VW splats. If the work-groups are divided among the cores (opencl/core_groups.h), a
// work-item processes several items. The values that they share are then computed only once.
UBS_FN void project_forward_items(uint item, SplatsInView view, UBS_GLOBAL real* records,
                                  UBS_GLOBAL uint* depth_keys, UBS_GLOBAL uint* tile_rects,
                                  UBS_GLOBAL uint* tile_counts) {
  UBS_NOINLINE
  CameraView cam = load_camera(view);
  UBS_CORE_ITEMS(item) {
    uint first = item * UBS_VW;
    if (first >= view.count) return;
    uint to = view.first_record + first;
    SplatRaw raw = load_splats(view, first, 0);
    ViewRay sight = view_ray_ahead(cam, raw);
    if (any_thin(raw))
      project_block(cam, raw, sight, 1, to, records, depth_keys, tile_rects, tile_counts);
    else
      project_block(cam, raw, sight, 0, to, records, depth_keys, tile_rects, tile_counts);
  }
}

UBS_KERNEL void project_forward(UBS_GLOBAL const real* params, uint count, uint stride, uint first_record,
                                UBS_GLOBAL const real* cameras, uint camera, real near_plane, real far_plane,
                                real eps2d, UBS_GLOBAL real* records, UBS_GLOBAL uint* depth_keys,
                                UBS_GLOBAL uint* tile_rects,
                                UBS_GLOBAL uint* tile_counts UBS_CORE_PARAMETERS) {
  SplatsInView view = {params, count, stride, first_record, cameras, camera, near_plane, far_plane, eps2d};
  project_forward_items(UBS_CORE_FIRST_ITEM, view, records, depth_keys, tile_rects, tile_counts);
}

#endif

#if !UBS_FORWARD_ONLY
// SummedGradient holds the gradients of projected splats. `contributing` is true in the lanes whose gradient is not
// zero.
typedef struct {
  SplatImageVjp v;
  vmask contributing;
} SummedGradient;

UBS_FN SummedGradient load_summed(SplatsInView view, UBS_GLOBAL const real* v_records, uint first) {
  UBS_GLOBAL const real* summed = v_records + ((size_t)view.first_record + first) * kGradStride;
  UBS_PREFETCH_RECORDS(UBS_PREFETCH, summed, kGradStride)
  Records r = load_records(summed);
  SummedGradient in;
  in.contributing = r.field[0] != V(0.0);
  UBS_UNROLL for (int k = 1; k <= (UBS_DEPTH_GRAD ? kGradDepth : kGradB); ++k) in.contributing =
      in.contributing | (r.field[k] != V(0.0));
  in.contributing = in.contributing & (ubs_lane_indices(first) < (vuint)(view.count));
  in.v.x = r.field[kGradX];
  in.v.y = r.field[kGradY];
  in.v.ellipse.w00 = r.field[kGradW00];
  in.v.ellipse.w01 = r.field[kGradW01];
  in.v.ellipse.w11 = r.field[kGradW11];
  in.v.opacity = r.field[kGradOpacity];
  in.v.beta = r.field[kGradBeta];
  in.v.r = r.field[kGradR];
  in.v.g = r.field[kGradG];
  in.v.b = r.field[kGradB];
  in.v.depth = UBS_DEPTH_GRAD ? r.field[kGradDepth] : V(0.0);
  return in;
}

#ifndef UBS_CAMERA_GRAD
UBS_FN SplatRaw raw_gradient(CameraView camera, SplatRaw raw, SplatImageVjp v) {
  ViewRay sight = view_ray_ahead(camera, raw);
  if (any_thin(raw)) return splat_vjp(camera, raw, sight, v, 1);
  return splat_vjp(camera, raw, sight, v, 0);
}

// Writes the gradient of the parameters. A splat that does not contribute gets exactly zero, even if its parameters are
// not finite. v_params has only the rows of trained parameters. The compiler removes computations that are only needed
// for other rows.
UBS_FN void store_gradient(SplatRaw gradient, vmask contributing, uint first, SplatsInView view,
                           UBS_GLOBAL real* v_params, uint accumulate) {
#if UBS_GAUSSIAN_ARRAYS
  (void)accumulate;  // the host does not ask for it
  UBS_UNROLL for (int k = 0; k < kRowCount; ++k) gradient.e[k] = contributing ? gradient.e[k] : V(0.0);
  store_gaussians(gradient, *(UBS_GLOBAL const GaussianArrays*)v_params, first, view.count);
#else
  UBS_UNROLL for (int k = 0; k < kRowCount; ++k) {
    if (UBS_TRAINED_ROW(k + 1) == UBS_TRAINED_ROW(k)) continue;
    UBS_GLOBAL real* row = v_params + (size_t)UBS_TRAINED_ROW(k) * view.stride + first;
    vreal value = contributing ? gradient.e[k] : V(0.0);
    UBS_PREFETCH_WRITE(row + UBS_PREFETCH_AHEAD * UBS_VW);
    if (accumulate) value += UBS_LOAD(row);
    UBS_STORE(value, row);
  }
#endif
}

UBS_FN void store_zero_gradient(uint first, SplatsInView view, UBS_GLOBAL real* v_params) {
#if UBS_GAUSSIAN_ARRAYS
  SplatRaw zero;
  UBS_UNROLL for (int k = 0; k < kRowCount; ++k) zero.e[k] = V(0.0);
  store_gaussians(zero, *(UBS_GLOBAL const GaussianArrays*)v_params, first, view.count);
#else
  UBS_UNROLL for (int k = 0; k < kTrainedRows; ++k)
      UBS_STORE(V(0.0), v_params + (size_t)k * view.stride + first);
#endif
}

UBS_FN void project_backward_items(uint item, SplatsInView view, UBS_GLOBAL const real* v_records,
                                   UBS_GLOBAL real* v_params, uint accumulate) {
  UBS_NOINLINE
  CameraView cam = load_camera(view);
  UBS_CORE_ITEMS(item) {
    uint first = item * UBS_VW;
    if (first >= view.count) return;
    SummedGradient in = load_summed(view, v_records, first);
    if (ubs_any(in.contributing)) {
      SplatRaw gradient = raw_gradient(cam, load_splats(view, first, 1), in.v);
      store_gradient(gradient, in.contributing, first, view, v_params, accumulate);
    } else if (!accumulate) {
      store_zero_gradient(first, view, v_params);
    }
  }
}

UBS_KERNEL void project_backward(UBS_GLOBAL const real* params, uint count, uint stride, uint first_record,
                                 UBS_GLOBAL const real* cameras, uint camera, real near_plane, real far_plane,
                                 real eps2d, UBS_GLOBAL const real* v_records, UBS_GLOBAL real* v_params,
                                 uint accumulate UBS_CORE_PARAMETERS) {
  SplatsInView view = {params, count, stride, first_record, cameras, camera, near_plane, far_plane, eps2d};
  project_backward_items(UBS_CORE_FIRST_ITEM, view, v_records, v_params, accumulate);
}
#endif
#endif
