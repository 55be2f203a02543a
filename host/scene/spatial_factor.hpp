// SPDX-License-Identifier: Apache-2.0
// The factor M of a splat's spatial covariance M M^T (method.md 2.1, 8) in double precision on the host, for
// every form of the method: for tools that look at single splats.
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

struct SpatialFactor {
  Matrix3 m{};
  std::array<double, 3> scale{};  // as kernels draw them: at least a small part of the largest
};

// The first three columns of M, which are all of it except with cov_param skew_nd and N > 3.
SpatialFactor spatial_factor(const SplatModel& model, std::size_t splat);

// kernels/math for one rot_mode, or for kMaxRotMode plus a cov_param; raw rotation entries and scales.
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
