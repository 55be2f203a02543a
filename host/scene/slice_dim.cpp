// SPDX-License-Identifier: Apache-2.0
// This file implements slice_at() and log_factor_at() of slice.hpp with the formulas of kernels/math in
// double precision. It is compiled once for each N (UBS_N) and each kind of conditioning (UBS_DIRECT); see
// slice.cpp.
#include <algorithm>

#include "host/scene/slice.hpp"

// clang-format off
#include "kernels/dialect/dialect.h"
#include "kernels/layout.h"
#include "kernels/limits.h"
#include "kernels/math/elementary.h"
#include "kernels/math/rotation.h"
#include "kernels/math/covariance.h"
#include "kernels/math/conditional.h"
#include "kernels/math/direct.h"
#include "kernels/math/ellipse.h"
#include "kernels/math/projection.h"
#include "kernels/math/colour.h"
#include "kernels/math/falloff.h"
#include "kernels/math/reach.h"
#include "kernels/math/splat.h"
// clang-format on

namespace ubs {

template <>
Slice slice_at<UBS_N, UBS_DIRECT>(const double* parameters, const QueryValues& query) {
  ::SplatRaw raw;
  std::copy_n(parameters, kRowCount, raw.e);
  const SpatialFrame frame = spatial_frame(splat_frame_raw(raw));
  FrameVec offset{};
  FrameMat shrink{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  Slice out;
  out.opacity = ubs_sigmoid(raw.e[kRowOpacity]);
#if UBS_C > 0
  CameraView camera{};
  ::Vec3 direction{};
  for (int k = 0; k < UBS_C; ++k)
    (k < UBS_FIRST_VALUE ? direction.e[k] : camera.query[k - UBS_FIRST_VALUE]) =
        query[static_cast<std::size_t>(k)];
  const SliceInput in = splat_slice_input(camera, raw, frame, direction, ::Vec3{}, 1);
  const Conditional conditional = slice_result(in, slice_forward(in));
  offset = conditional.offset;
  shrink = conditional.shrink;
  out.opacity *= splat_attenuation(conditional);
#else
  (void)query;
#endif
  for (std::size_t a = 0; a < 3; ++a) {
    out.mean[a] = raw.e[kRowXyz + a];
    for (int k = 0; k < 3; ++k)
      out.mean[a] +=
          (UBS_DIRECT ? (static_cast<int>(a) == k) * mean_scale(frame.scale) : frame.m.e[a][k]) * offset.e[k];
    for (std::size_t b = a; b < 3; ++b) {
      double sum = 0;
      for (int k = 0; k < 3; ++k)
        for (int l = 0; l < 3; ++l) sum += frame.m.e[a][k] * shrink.e[k][l] * frame.m.e[b][l];
      out.covariance[a][b] = out.covariance[b][a] = sum;
    }
  }
  return out;
}

template <>
double log_factor_at<UBS_N, UBS_DIRECT>(const double* parameters, const QueryValues& residual) {
#if UBS_C > 0
  ::Slice slice;
  SliceInput in;
  for (int k = 0; k < UBS_C; ++k) {
    slice.y.e[k] = residual[static_cast<std::size_t>(k)];
    in.exponent.e[k] = 4 * ubs_exp(parameters[kRowQueryBeta + k]);
  }
  return slice_log_factor(in, slice_attenuation(slice));
#else
  (void)parameters, (void)residual;
  return 0;
#endif
}

}  // namespace ubs
