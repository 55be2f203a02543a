// SPDX-License-Identifier: Apache-2.0
// CovarianceAxes describes a covariance by a rotation and the variances along the rotated axes.
#pragma once

#include <array>

#include "host/scene/spatial_factor.hpp"

namespace ubs {

struct CovarianceAxes {
  std::array<double, 4> rotation{1, 0, 0, 0};  // quaternion w x y z, unit length
  // Variances along the rotated axes, never negative. covariance_axes() returns them in descending order.
  std::array<double, 3> variance{};
};

// Decomposes a covariance. All variances of the result are positive: a variance that is smaller than a
// millionth of the largest variance, or than 1e-30, is raised to the larger of these two values.
CovarianceAxes covariance_axes(const double (&covariance)[3][3]);

// Decomposes M M^T, where M is `factor`. The singular values of M are used, because they are accurate for
// thin axes too. A variance may be 0.
CovarianceAxes covariance_axes(const Matrix3& factor);

}  // namespace ubs
