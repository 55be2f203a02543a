// SPDX-License-Identifier: Apache-2.0
// Models between the two forms of conditioning (method.md 9.3), a splat at a time in double precision. The
// spatial factor of the result is `cholesky`, which has every covariance.
#pragma once

#include <cstddef>

#include "host/scene/splat_model.hpp"

namespace ubs {

struct Reconditioned {
  SplatModel model;
  // Splats whose conditional covariance was indefinite, so that they were culled from some sides: their least
  // axes were raised to the least that the form has.
  std::size_t indefinite = 0;
  // Change of the factor of opacities, at 32 queries within the splat's query covariance: mean over splats,
  // largest. Only beta_opacity tanh has one, where query dimensions are correlated: its residuals are taken
  // in the other order.
  double opacity_mean = 0, opacity_most = 0;
};

// Weights that are no exponents too become part of the cross covariance (beta_cond off). Throws Error(usage)
// with cov_param skew_nd and for a model that is in the form.
Reconditioned to_direct(const SplatModel& model);

// Throws Error(data) naming the number of splats that no covariance has: means that move by weighted query
// dimensions may need more spread in space than a splat has.
Reconditioned to_covariance(const SplatModel& model);

}  // namespace ubs
