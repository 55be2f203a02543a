// SPDX-License-Identifier: Apache-2.0
// Slicer computes the conditional mean, covariance and opacity of a splat at a query (direction, time, ...)
// (method.md 2.3, 2.4, 9), in double precision on the host. It is used by tools that examine single splats.
// knows() returns which variants are supported.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "kernels/limits.h"

namespace ubs {

inline constexpr std::size_t kMaxQuery = kMaxDim - 3;
using QueryValues = std::array<double, kMaxQuery>;

struct Slice {
  double opacity = 0;
  std::array<double, 3> mean{};
  double covariance[3][3] = {};  // symmetric: the lower triangle is a copy of the upper one
};

// Computes the slice of a splat with N = `dim` with the formulas of kernels/math. `direct` is 1 for direct
// conditioning, otherwise 0. `parameters` has the rows of the published variant with this conditioning.
template <int dim, int direct>
Slice slice_at(const double* parameters, const QueryValues& query);
// Returns the logarithm of the opacity factor of the splat (method.md 2.4) for the residual y of the query.
// It is Lh^-1 x with covariance conditioning, and L^T x with direct conditioning.
template <int dim, int direct>
double log_factor_at(const double* parameters, const QueryValues& residual);
#define UBS_DECLARE(n, direct)                                                   \
  template <>                                                                    \
  Slice slice_at<n, direct>(const double* parameters, const QueryValues& query); \
  template <>                                                                    \
  double log_factor_at<n, direct>(const double* parameters, const QueryValues& residual);
#define UBS_DECLARE_FORMS(n) UBS_DECLARE(n, 0) UBS_DECLARE(n, 1)
UBS_EACH_N(UBS_DECLARE_FORMS)
#undef UBS_DECLARE_FORMS
#undef UBS_DECLARE

class Slicer {
 public:
  // Returns whether the variant is supported. Spatial kernel, colour, antialiasing and conditioning may have
  // any value; the other switches must have their published values.
  static bool knows(const ModelVariant& variant);

  Slicer(const SplatModel& model, std::size_t splat);

  const std::array<double, 3>& mean() const { return mean_; }
  double beta() const { return beta_; }  // exponent of the spatial kernel; 0 if it has none
  // These functions call slice_at() and log_factor_at() with the parameters of the splat.
  Slice at(const QueryValues& query) const;
  double log_factor(const QueryValues& residual) const;

 private:
  int dim_;
  bool direct_;
  std::vector<double> parameters_;
  std::array<double, 3> mean_{};
  double beta_ = 0;
};

}  // namespace ubs
