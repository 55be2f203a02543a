// SPDX-License-Identifier: Apache-2.0
// See import_splats.hpp.
#include "host/data/import_splats.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/data/skew_rotation.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs {
namespace {

constexpr double kExact = 1e-3;     // of the whitened covariance: invisible
constexpr float kNoInfluence = -8;  // raw beta: the factor stays above 0.998 (method.md 5.4)

void place(SplatModel& model, const ImportedSplats& splats, std::size_t i, const SkewFactors& factors,
           double support) {
  const ParameterLayout layout = model.layout();
  const auto skew = factors.skew();
  for (std::size_t k = 0; k < 3; ++k) {
    const int axis = static_cast<int>(k);
    model.row(layout.xyz + axis)[i] = splats.positions[i][k];
    model.row(layout.rgb + axis)[i] =
        static_cast<float>(kShC0 * splats.sh[i * 3 * splats.coefficients() + k] + 0.5);
    model.row(layout.scale + axis)[i] = static_cast<float>(inverse_softplus_of(support * factors.scale[k]));
    model.row(layout.l_triangle + axis)[i] = static_cast<float>(skew[k]);
  }
  model.row(layout.opacity)[i] = splats.opacity_logits[i];
  model.row(layout.beta)[i] = splats.betas.empty() ? 0.0f : splats.betas[i];
  for (int q = 0; q < layout.query; ++q) {
    model.row(layout.beta + 1 + q)[i] = kNoInfluence;
    model.row(layout.scale + 3 + q)[i] = static_cast<float>(inverse_softplus_of(1.0));
  }
}

void summarise(std::vector<double> errors, ImportedModel& result) {
  std::erase_if(errors, [](double e) { return e <= kExact; });
  result.inexact = errors.size();
  if (errors.empty()) return;
  std::ranges::sort(errors);
  result.median_error = errors[errors.size() / 2];
  result.worst_error = errors.back();
}

}  // namespace

ImportedModel import_splats(const ImportedSplats& splats, const ImportOptions& options) {
  if (!(options.support >= 1 && options.support <= 20))
    fail(ErrorKind::usage, "support ratio {} must lie between 1 and 20: 3.0 as published, 3.08 fits best",
         options.support);
  ImportedModel result{SplatModel(options.dim, splats.count())};
  result.support = splats.kernel == SpatialKernel::beta ? 1.0 : options.support;
  result.harmonics_lost = splats.sh_degree > 0;
  std::vector<double> errors(splats.count());
  constexpr std::size_t kBlock = 512;
  parallel_for((splats.count() + kBlock - 1) / kBlock, [&](std::size_t block) {
    const std::size_t end = std::min(splats.count(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      const auto& q = splats.rotations[i];
      std::array<double, 3> scale{};
      for (std::size_t k = 0; k < 3; ++k) scale[k] = std::exp(static_cast<double>(splats.log_scales[i][k]));
      // Below this ratio of the axes the problem is singular in double; a disc stays a disc.
      const double floor = 1e-4 * *std::ranges::max_element(scale);
      for (double& s : scale) s = std::max(s, floor);
      const SkewFactors factors = fit_skew_rotation({q[0], q[1], q[2], q[3]}, scale);
      errors[i] = factors.error;
      place(result.model, splats, i, factors, result.support);
    }
  });
  summarise(std::move(errors), result);
  return result;
}

}  // namespace ubs
