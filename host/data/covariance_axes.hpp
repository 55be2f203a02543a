// SPDX-License-Identifier: Apache-2.0
// A covariance as rotation and variances along its axes.
#pragma once

#include <array>

#include "host/scene/spatial_factor.hpp"

namespace ubs {

struct CovarianceAxes {
  std::array<double, 4> rotation{1, 0, 0, 0};  // quaternion w x y z, unit length
  std::array<double, 3> variance{};            // falling, all positive
};

// An indefinite covariance has no thickness along some axis: a thousandth of the longest one stands for it.
CovarianceAxes covariance_axes(const double (&covariance)[3][3]);

// Of M M^T, from the singular values of M: thin axes keep their accuracy. A variance may be 0.
CovarianceAxes covariance_axes(const Matrix3& factor);

}  // namespace ubs
