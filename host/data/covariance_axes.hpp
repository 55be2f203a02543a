// SPDX-License-Identifier: Apache-2.0
// CovarianceAxes describes a covariance by a rotation and the variances along the rotated axes.
#pragma once

#include <array>

#include "host/scene/spatial_factor.hpp"

namespace ubs {

struct CovarianceAxes {
  std::array<double, 4> rotation{1, 0, 0, 0};  // quaternion w x y z, unit length
  std::array<double, 3> variance{};            // descending, all positive
};

// Decomposes a covariance. If it is not positive definite, variances that are too small are raised to a
// millionth of the largest one, so the standard deviation along such an axis is a thousandth of the largest
// one.
CovarianceAxes covariance_axes(const double (&covariance)[3][3]);

// Decomposes M M^T, using the singular values of M, so that thin axes keep their accuracy. A variance may be
// 0.
CovarianceAxes covariance_axes(const Matrix3& factor);

}  // namespace ubs
