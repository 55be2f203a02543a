// SPDX-License-Identifier: Apache-2.0
// to_direct() and to_covariance() convert models between the two kinds of conditioning (method.md 9.3), one
// splat at a time in double precision. The result has cov_param = cholesky, which can represent every spatial
// covariance.
#pragma once

#include <cstddef>

#include "host/scene/splat_model.hpp"

namespace ubs {

struct Reconditioned {
  SplatModel model;
  // Number of splats whose conditional covariance was indefinite, so that they were culled when seen from
  // some directions. Their shortest axes were raised to the minimum of direct conditioning.
  std::size_t indefinite = 0;
  // Change of the opacity factor: the mean and the maximum over all splats. The change of a splat is the mean
  // absolute difference at 32 random queries within its query covariance. It is 0 unless beta_opacity is tanh
  // and query dimensions are correlated. In that case, the residual y (method.md 2.4) uses the query
  // dimensions in the opposite order after the conversion.
  double opacity_mean = 0, opacity_most = 0;
};

// Converts to direct conditioning. With beta_opacity = tanh, the conditioning weights (beta_cond) are also
// exponents of the opacity, so the result keeps them. Otherwise, they become part of the cross covariance,
// and the result has beta_cond = off. Throws Error(usage) for a model with cov_param = skew_nd and for a
// model that already has direct conditioning.
Reconditioned to_direct(const SplatModel& model);

// Converts to covariance conditioning. Throws Error(data) with the number of splats that no covariance can
// represent. This can happen for splats with conditioning weights below 1: the motion of their mean with the
// query may require a larger spatial extent than they have. Throws Error(usage) for a model without direct
// conditioning.
Reconditioned to_covariance(const SplatModel& model);

}  // namespace ubs
