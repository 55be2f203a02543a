// SPDX-License-Identifier: Apache-2.0
// See reduce_splats.hpp.
#include "host/formats/reduce_splats.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/formats/covariance_axes.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/gaussian_model.hpp"
#include "host/scene/slice.hpp"
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"

namespace ubs {
namespace {

std::vector<std::array<double, 3>> sphere_directions() {
  constexpr int kDirections = 32;
  std::vector<std::array<double, 3>> directions;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1 - (2 * i + 1.0) / kDirections, r = std::sqrt(1 - z * z);
    const double angle = i * std::numbers::pi * (3 - std::sqrt(5.0));  // the golden angle
    directions.push_back({r * std::cos(angle), r * std::sin(angle), z});
  }
  return directions;
}

struct Reduced {
  double opacity = 0;
  std::array<double, 3> mean{};
  double covariance[3][3] = {};
};

// Combines the slices of one splat, which are its positions, covariances and opacities for the chosen view
// directions. Computes the mean and the covariance of the mixture of the slices, weighted by their opacities,
// and an opacity according to `rule`, which is ReduceOptions::opacity.
Reduced combine(const std::vector<Slice>& slices, const std::string& rule) {
  double sum = 0, squares = 0, largest = 0;
  for (const auto& s : slices) {
    sum += s.opacity, squares += s.opacity * s.opacity;
    largest = std::max(largest, s.opacity);
  }
  Reduced r;
  if (!(sum > 0)) return r;
  r.opacity = rule == "mean"       ? sum / static_cast<double>(slices.size())
              : rule == "weighted" ? squares / sum
                                   : largest;
  for (const auto& s : slices)
    for (std::size_t k = 0; k < 3; ++k) r.mean[k] += s.opacity / sum * s.mean[k];
  for (const auto& s : slices)
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b)
        r.covariance[a][b] +=
            s.opacity / sum * (s.covariance[a][b] + (s.mean[a] - r.mean[a]) * (s.mean[b] - r.mean[b]));
  return r;
}

void store(ImportedSplats& out, std::size_t i, const Reduced& r, double ratio) {
  const CovarianceAxes axes = covariance_axes(r.covariance);
  for (std::size_t k = 0; k < 4; ++k) out.rotations[i][k] = static_cast<float>(axes.rotation[k]);
  for (std::size_t k = 0; k < 3; ++k) {
    out.log_scales[i][k] = static_cast<float>(0.5 * std::log(axes.variance[k]) - std::log(ratio));
    out.positions[i][k] = static_cast<float>(r.mean[k]);
  }
  out.opacity_logits[i] = logit_of(r.opacity);
}

// Converts a model with N = 3. Its splats depend on neither time nor view direction, so nothing is averaged,
// and only the kernel is replaced.
ImportedSplats with_gaussian_kernel(const SplatModel& model) {
  ImportedSplats out = to_imported_splats(model);
  for (std::size_t i = 0; i < out.count(); ++i) {
    const double beta =
        out.betas.empty() ? 0 : 4 * std::exp(std::min(double{out.betas[i]}, UBS_BETA_RAW_MAX));
    const double ratio = row_of(out.kernel).gaussian_ratio(beta);
    for (float& scale : out.log_scales[i]) scale -= static_cast<float>(std::log(ratio));
  }
  out.betas.clear();
  out.kernel = SpatialKernel::gaussian;
  return out;
}

ImportedSplats averaged(const SplatModel& model, const ReduceOptions& options) {
  const ParameterLayout layout = model.layout();
  const auto ratio = row_of(model.variant.kernel).gaussian_ratio;
  const bool directional = layout.query >= 3, timed = layout.query != 3;
  const std::size_t time_at = directional ? 3 : 0;
  ImportedSplats out;
  out.sh_degree = harmonic_degree(model.variant);
  out.antialiased = model.variant.antialias == Antialias::on;
  out.resize(model.count);
  const auto directions = sphere_directions();
  parallel_for((model.count + 255) / 256, [&](std::size_t block) {
    std::vector<Slice> slices;
    for (std::size_t i = block * 256; i < std::min(model.count, (block + 1) * 256); ++i) {
      const Slicer slicer(model, i);
      slices.clear();
      const std::size_t views = !directional                 ? 1
                                : options.viewpoints.empty() ? directions.size()
                                                             : options.viewpoints.size();
      for (std::size_t v = 0; v < views; ++v) {
        QueryValues q{};
        if (directional && options.viewpoints.empty()) std::copy_n(directions[v].begin(), 3, q.begin());
        if (directional && !options.viewpoints.empty()) {
          double norm = 0;
          for (std::size_t k = 0; k < 3; ++k) {
            q[k] = slicer.mean()[k] - options.viewpoints[v][k];
            norm += q[k] * q[k];
          }
          for (std::size_t k = 0; k < 3; ++k) q[k] /= std::max(1e-12, std::sqrt(norm));
        }
        if (timed) q[time_at] = options.time;
        slices.push_back(slicer.at(q));
      }
      store(out, i, combine(slices, options.opacity), ratio(slicer.beta()));
      copy_colour(model, i, out);
    }
  });
  return out;
}

}  // namespace

ImportedSplats reduce_splats(const SplatModel& model, const ReduceOptions& options) {
  if (options.opacity != "mean" && options.opacity != "weighted" && options.opacity != "max")
    fail(ErrorKind::usage, "unknown reduction '{}': choose mean, weighted or max", options.opacity);
  if (!row_of(model.variant.kernel).gaussian_ratio)
    fail(ErrorKind::usage, "models with kernel = {} cannot be converted to Gaussians",
         row_of(model.variant.kernel).name);
  if (model.dim > 3 && !Slicer::knows(model.variant))
    fail(ErrorKind::usage,
         "models of the variant '{}' cannot be converted to Gaussians: only kernel, colour, antialias and "
         "conditioning may differ from the default variant",
         to_string(model.variant));
  ImportedSplats out = model.dim == 3 ? with_gaussian_kernel(model) : averaged(model, options);
  for (std::size_t i = 0; i < out.count(); ++i)
    if (sigmoid_of(out.opacity_logits[i]) < options.least_opacity)
      out.opacity_logits[i] = std::numeric_limits<float>::quiet_NaN();
  clean(out);
  for (auto& s : out.report.skipped)
    if (s.why == "the opacity is not a number")
      s.why = fmt::format("the reduced opacity is below {:.4f}", options.least_opacity);
  return out;
}

}  // namespace ubs
