// SPDX-License-Identifier: Apache-2.0
// A splat seen at a query (direction, time, ...): its conditional mean, covariance and opacity
// (method.md 2.3, 2.4) in double precision on the host, for tools that look at single splats. The published
// form only.
#pragma once

#include <array>
#include <cstddef>

#include "host/scene/splat_model.hpp"

namespace ubs {

inline constexpr std::size_t kMaxQuery = kMaxDim - 3;
using QueryValues = std::array<double, kMaxQuery>;

struct Slice {
  double opacity = 0;
  std::array<double, 3> mean{};
  double covariance[3][3] = {};  // the upper triangle, mirrored
};

// One splat with everything that does not depend on the query.
class Slicer {
 public:
  // The spatial kernel, the colour and antialiasing do not matter; the rest must be the published form.
  static bool knows(const ModelVariant& variant);

  Slicer(const SplatModel& model, std::size_t splat);

  std::size_t query_count() const { return c_; }
  const std::array<double, 3>& mean() const { return mean_; }
  double opacity() const { return opacity_; }  // base opacity
  double beta() const { return beta_; }        // exponent of the spatial kernel; 0 where there is none
  Slice at(const QueryValues& query) const;

 private:
  void factorise(const double (&rows)[kMaxQuery][3 + kMaxQuery]);
  QueryValues forward(QueryValues v) const;
  QueryValues solve(const QueryValues& v) const;

  std::size_t c_ = 0;
  std::array<double, 3> mean_{};
  double opacity_ = 0, beta_ = 0;
  double sigma_x_[3][3] = {}, x_[3][kMaxQuery] = {};  // spatial covariance, cross covariance
  double chol_[kMaxQuery][kMaxQuery] = {};
  QueryValues mean_q_{}, beta_q_{}, weight_{};
};

}  // namespace ubs
