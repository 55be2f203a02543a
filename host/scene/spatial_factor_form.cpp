// SPDX-License-Identifier: Apache-2.0
// This file implements spatial_factor_as() of spatial_factor.hpp with the formulas of kernels/math in double
// precision. It is compiled once for each variant of the spatial factor (UBS_ROT_MODE, UBS_COV_PARAM).
#include <algorithm>

#include "host/scene/spatial_factor.hpp"

// clang-format off
#include "kernels/dialect/dialect.h"
#include "kernels/layout.h"
#include "kernels/limits.h"
#include "kernels/math/elementary.h"
#include "kernels/math/rotation.h"
#include "kernels/math/covariance.h"
// clang-format on

namespace ubs {

template <>
SpatialFactor spatial_factor_as<UBS_COV_PARAM == 0 ? UBS_ROT_MODE : kMaxRotMode + UBS_COV_PARAM>(
    const double* rotation, const double* scale) {
  FrameRaw raw;
  std::copy_n(rotation, kFrameRots, raw.rotation);
  std::copy_n(scale, 3, raw.scale);
  const SpatialFrame frame = spatial_frame(raw);
  SpatialFactor out;
  for (std::size_t r = 0; r < 3; ++r) {
    std::copy_n(frame.m.e[r], 3, out.m[r].begin());
    out.scale[r] = frame.scale.e[r];
  }
  return out;
}

}  // namespace ubs
