// SPDX-License-Identifier: Apache-2.0
// Computes the gradient of a view's camera, which is a sum over the splats. The functions of kernels/math/splat.h,
// compiled with UBS_CAMERA_GRAD, compute the term of each splat.

UBS_FN CameraVjp camera_gradient(CameraView camera, SplatRaw raw, SplatImageVjp v) {
  ViewRay sight = view_ray_ahead(camera, raw);
  if (any_thin(raw)) return splat_vjp(camera, raw, sight, v, 1);
  return splat_vjp(camera, raw, sight, v, 0);
}

UBS_FN void camera_backward_lanes(uint lane, SplatsInView view, UBS_GLOBAL const real* v_records,
                                  UBS_GLOBAL real* v_camera, uint lanes) {
  UBS_NOINLINE
  CameraView cam = load_camera(view);
  CameraVjp sum;
  UBS_UNROLL for (int k = 0; k < kCameraGrads; ++k) sum.e[k] = V(0.0);
  for (uint first = lane; first < view.count; first += lanes) {
    SummedGradient in = load_summed(view, v_records, first);
    if (!ubs_any(in.contributing)) continue;
    CameraVjp part = camera_gradient(cam, load_splats(view, first, 1), in.v);
    UBS_UNROLL for (int k = 0; k < kCameraGrads; ++k) sum.e[k] += in.contributing ? part.e[k] : V(0.0);
  }
  UBS_UNROLL for (int k = 0; k < kCameraGrads; ++k) UBS_STORE(sum.e[k], v_camera + (size_t)k * lanes + lane);
}

// Lane l adds the terms of the splats l, l + lanes, l + 2 lanes and so on, in this order, and writes its sums to column
// l of v_camera, which has the shape (kCameraGrads, lanes). The host adds the results of the lanes. The number of lanes
// is a multiple of 64.
UBS_KERNEL void camera_backward(UBS_GLOBAL const real* params, uint count, uint stride, uint first_record,
                                UBS_GLOBAL const real* cameras, uint camera, real near_plane, real far_plane,
                                real eps2d, UBS_GLOBAL const real* v_records, UBS_GLOBAL real* v_camera, uint lanes) {
  SplatsInView view = {params, count, stride, first_record, cameras, camera, near_plane, far_plane, eps2d};
  uint lane = UBS_GLOBAL_ID(0) * UBS_VW;
  if (lane < lanes) camera_backward_lanes(lane, view, v_records, v_camera, lanes);
}
