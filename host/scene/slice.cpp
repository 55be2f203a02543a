// SPDX-License-Identifier: Apache-2.0
#include "host/scene/slice.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"

namespace ubs {
namespace {

// Formulas holds the functions of slice.hpp for one N and one kind of conditioning.
struct Formulas {
  Slice (*slice)(const double*, const QueryValues&);
  double (*log_factor)(const double*, const QueryValues&);
};

template <int direct, int... dims>
const Formulas& formulas_of(std::integer_sequence<int, dims...>, int dim) {
  static constexpr Formulas kTable[]{
      {slice_at<kMinDim + dims, direct>, log_factor_at<kMinDim + dims, direct>}...};
  return kTable[dim - kMinDim];
}

const Formulas& formulas(int dim, bool direct) {
  constexpr auto kDims = std::make_integer_sequence<int, kMaxDim - kMinDim + 1>();
  return direct ? formulas_of<1>(kDims, dim) : formulas_of<0>(kDims, dim);
}

}  // namespace

bool Slicer::knows(const ModelVariant& variant) {
  ModelVariant published = variant;
  published.rot_mode = {};
  published.cov_param = {};
  published.beta_cond = {};
  published.beta_opacity = {};
  published.cov_mode = {};
  return published == variant;
}

// Copies the parameters of the splat to the rows that they have in the published variant. The colours are not
// copied, because a slice does not depend on them.
Slicer::Slicer(const SplatModel& model, std::size_t splat)
    : dim_(model.dim), direct_(model.variant.direct()) {
  const ParameterLayout from = model.layout(), to(model.dim, {});
  parameters_.resize(static_cast<std::size_t>(to.count));
  const auto copy = [&](int row, int from_row, int count) {
    for (int k = 0; k < count; ++k)
      parameters_[static_cast<std::size_t>(row + k)] = static_cast<double>(model.row(from_row + k)[splat]);
  };
  copy(to.xyz, from.xyz, 3);
  copy(to.opacity, from.opacity, 1);
  if (from.variant.has_spatial_beta()) copy(to.beta, from.beta, 1);
  copy(to.query_beta, from.query_beta, to.count - to.query_beta);
  std::copy_n(parameters_.begin() + to.xyz, 3, mean_.begin());
  if (from.variant.has_spatial_beta())
    beta_ = 4 * std::exp(std::min(parameters_[static_cast<std::size_t>(to.beta)], UBS_BETA_RAW_MAX));
}

Slice Slicer::at(const QueryValues& query) const {
  return formulas(dim_, direct_).slice(parameters_.data(), query);
}

double Slicer::log_factor(const QueryValues& residual) const {
  return formulas(dim_, direct_).log_factor(parameters_.data(), residual);
}

}  // namespace ubs
