// SPDX-License-Identifier: Apache-2.0
// The factor M of a splat's spatial covariance M M^T (method.md 2.1, 8) in double precision on the host, for
// every form of the method: for tools that look at single splats. Kernels have their own (kernels/math).
#pragma once

#include <array>
#include <cstddef>

#include "host/scene/splat_model.hpp"

namespace ubs {

using Matrix3 = std::array<std::array<double, 3>, 3>;

// ln(1 + e^x); linear above 20, as the published code.
double softplus_of(double raw);
// Its inverse for y > 0; values below 1e-30 are taken as that.
double inverse_softplus_of(double y);

// The first three columns of M, which are all of it except with cov_param skew_nd and N > 3.
Matrix3 spatial_factor(const SplatModel& model, std::size_t splat);

// Rotation of a quaternion w x y z of any length (not zero).
Matrix3 quaternion_matrix(const std::array<double, 4>& wxyz);

}  // namespace ubs
