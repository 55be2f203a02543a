// SPDX-License-Identifier: Apache-2.0
// spatial_factor() computes the factor M of the spatial covariance M M^T of a splat (method.md 2.1, 8), in
// double precision on the host and for every variant. It serves tools that examine single splats.
#pragma once

#include <array>
#include <cstddef>

#include "host/scene/splat_model.hpp"

namespace ubs {

using Matrix3 = std::array<std::array<double, 3>, 3>;

// Returns ln(1 + e^x); linear above 20, as in the published code.
double softplus_of(double raw);
// Returns the inverse of softplus for y > 0. Values below 1e-30 count as 1e-30.
double inverse_softplus_of(double y);

struct SpatialFactor {
  Matrix3 m{};
  std::array<double, 3> scale{};  // as used by the kernels: at least a small share of the largest scale
};

// Returns the first three columns of M. M has no others, except with cov_param skew_nd and N > 3.
SpatialFactor spatial_factor(const SplatModel& model, std::size_t splat);

// Evaluates kernels/math for one rot_mode, or for kMaxRotMode plus a cov_param, with raw rotation entries and
// scales.
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
