// SPDX-License-Identifier: Apache-2.0
// spatial_factor() computes the factor M of the spatial covariance M M^T of a splat (method.md 2.1, 8), in
// double precision on the host. It supports every variant. It is used by tools that examine single splats.
#pragma once

#include <array>
#include <cstddef>

#include "host/scene/splat_model.hpp"

namespace ubs {

using Matrix3 = std::array<std::array<double, 3>, 3>;

// Returns ln(1 + e^x), where x is `raw`. For x > 20 it returns x, as the published code does.
double softplus_of(double raw);
// Returns the inverse of softplus for y > 0. Values below 1e-30 count as 1e-30.
double inverse_softplus_of(double y);

struct SpatialFactor {
  Matrix3 m{};
  // Scales after the clamp of the kernels: each is at least a small fraction of the largest scale.
  std::array<double, 3> scale{};
};

// Returns the first three columns of M. M has more columns only if cov_param is skew_nd and N > 3.
SpatialFactor spatial_factor(const SplatModel& model, std::size_t splat);

// Computes the factor from raw rotation entries and raw scales with the formulas of kernels/math. `form` is
// the number of the rot_mode with cov_param = spatial_ortho. For the other values of cov_param, `form` is
// kMaxRotMode plus the number of the cov_param.
inline constexpr int kMaxRotMode = static_cast<int>(RotMode::quaternion);
template <int form>
SpatialFactor spatial_factor_as(const double* rotation, const double* scale);
template <>
SpatialFactor spatial_factor_as<0>(const double* rotation, const double* scale);
template <>
SpatialFactor spatial_factor_as<1>(const double* rotation, const double* scale);
template <>
SpatialFactor spatial_factor_as<2>(const double* rotation, const double* scale);
template <>
SpatialFactor spatial_factor_as<3>(const double* rotation, const double* scale);
template <>
SpatialFactor spatial_factor_as<4>(const double* rotation, const double* scale);
template <>
SpatialFactor spatial_factor_as<5>(const double* rotation, const double* scale);
template <>
SpatialFactor spatial_factor_as<6>(const double* rotation, const double* scale);

}  // namespace ubs
