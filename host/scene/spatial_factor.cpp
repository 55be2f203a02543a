// SPDX-License-Identifier: Apache-2.0
#include "host/scene/spatial_factor.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace ubs {
namespace {

template <int... forms>
SpatialFactor factor_of(std::integer_sequence<int, forms...>, int form, const double* rotation,
                        const double* scale) {
  constexpr SpatialFactor (*kTable[])(const double*, const double*){spatial_factor_as<forms>...};
  return kTable[form](rotation, scale);
}

}  // namespace

double softplus_of(double raw) { return raw > 20 ? raw : std::log1p(std::exp(raw)); }

double inverse_softplus_of(double y) {
  y = std::max(y, 1e-30);
  return y > 20 ? y : y + std::log(-std::expm1(-y));
}

SpatialFactor spatial_factor(const SplatModel& model, std::size_t splat) {
  const ParameterLayout l = model.layout();
  const auto at = [&](int row) { return static_cast<double>(model.row(row)[splat]); };
  const bool quaternion = l.variant.rot_mode == RotMode::quaternion;
  const double rotation[4] = {at(l.l_triangle), at(l.l_triangle + 1), at(l.l_triangle + 2),
                              quaternion ? at(l.l_triangle + 3) : 0};
  const double scale[3] = {at(l.scale), at(l.scale + 1), at(l.scale + 2)};
  const int cov_param = static_cast<int>(l.variant.cov_param);
  const int form = cov_param > 0 ? kMaxRotMode + cov_param : static_cast<int>(l.variant.rot_mode);
  constexpr int kForms = kMaxRotMode + static_cast<int>(CovParam::skew_nd) + 1;
  return factor_of(std::make_integer_sequence<int, kForms>(), form, rotation, scale);
}

}  // namespace ubs
