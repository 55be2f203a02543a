// SPDX-License-Identifier: Apache-2.0
// See splat_values.hpp. This file computes the activations of docs/method.md, section 1.1, in double
// precision on the host.
#include "host/look/report/splat_values.hpp"

#include <algorithm>
#include <cmath>

namespace ubs {
namespace {

constexpr double kConstantHarmonic = 0.28209479177387814;  // Y_0^0 = 1 / (2 sqrt(pi))

double softplus(double x) { return std::max(x, 0.0) + std::log1p(std::exp(-std::abs(x))); }
double exponent(double raw) { return 4 * std::exp(raw); }
double weight(double raw) { return std::min(std::exp(raw), 1.0); }
double unchanged(double raw) { return raw; }

struct Rows {
  int first = 0, count = 0;
};
// These functions return the query dimensions of each kind. `first` is an index among the query dimensions.
Rows directions(const ParameterLayout& l) { return {0, l.dim >= 6 ? 3 : 0}; }
Rows time(const ParameterLayout& l) { return {directions(l).count, has_time(l.dim) ? 1 : 0}; }
Rows further(const ParameterLayout& l) {
  const int first = directions(l).count + time(l).count;
  return {first, l.query - first};
}
Rows shifted(int by, const Rows& rows) { return {rows.first + by, rows.count}; }

class Collector {
 public:
  explicit Collector(const MixedModel& model) : model_(model) {}

  template <typename RowsOf, typename Activation>
  void add(SplatQuantity quantity, const RowsOf& rows_of, const Activation& activation) {
    for (const SplatModel& group : model_.groups) {
      const Rows rows = rows_of(group.layout());
      for (int r = rows.first; r < rows.first + rows.count; ++r)
        for (const float raw : group.row(r)) quantity.values.push_back(activation(raw));
    }
    if (!quantity.values.empty()) quantities_.push_back(std::move(quantity));
  }
  std::vector<SplatQuantity> take() { return std::move(quantities_); }

 private:
  const MixedModel& model_;
  std::vector<SplatQuantity> quantities_;
};

using Layout = const ParameterLayout&;

void add_betas(Collector& out, const ModelVariant& variant) {
  if (variant.has_spatial_beta())
    out.add(
        {"spatial beta",
         row_of(variant.kernel).beta_formula,
         row_of(variant.kernel).beta_meaning,
         true,
         false,
         {}},
        [](Layout l) {
          return Rows{l.beta, 1};
        },
        exponent);
  if (!variant.has_query_beta()) return;
  const auto add = [&](const char* of, const char* meaning, Rows (*which)(Layout)) {
    const std::string name = of;
    const auto rows = [which](Layout l) { return shifted(l.query_beta, which(l)); };
    if (variant.beta_opacity == BetaOpacity::tanh)
      out.add({name + " beta", "exponent of 1 - d", meaning, true, false, {}}, rows, exponent);
    if (variant.beta_cond == BetaCond::on)
      out.add(
          {name + " conditioning",
           "weight",
           variant.learnt_weights() ? "sigmoid(lambda): factor of the motion with the query"
                                    : "min(exp(b), 1): factor of the motion with the query (Gaussians: 1)",
           false,
           true,
           {}},
          rows, variant.learnt_weights() ? sigmoid : weight);
  };
  add("direction", "4 exp(b); low: diffuse, high: visible from few directions only", directions);
  add("time", "4 exp(b); low: static, high: visible only for a short time", time);
  add("further query", "4 exp(b), for query dimensions other than direction and time", further);
}

void add_scales(Collector& out, const ModelVariant& variant) {
  const std::string radius =
      row_of(variant.kernel).scale_is_support ? "radius of the support" : "standard deviation";
  const std::string form =
      variant.cov_param == CovParam::spatial_ortho ? "along its axes" : "diagonal of the covariance's factor";
  out.add(
      {"spatial scale", "scene units", radius + ", " + form, true, false, {}},
      [](Layout l) {
        return Rows{l.scale, 3};
      },
      softplus);
  const bool direct = variant.direct();
  const auto add = [&](const char* name, const char* unit, Rows (*which)(Layout)) {
    out.add(
        {name,
         unit,
         direct ? "reciprocal of the diagonal of the precision factor" : "width in the query dimension",
         true,
         false,
         {}},
        [which](Layout l) { return shifted(l.scale + 3, which(l)); },
        direct ? +[](double raw) { return 1 / softplus(raw); } : softplus);
  };
  add("direction scale", "relative to a view direction of length 1", directions);
  add("time scale", "relative to the duration of the scene", time);
  add("further query scale", "query units", further);
}

void add_colours(Collector& out, const ModelVariant& variant) {
  const bool harmonics = variant.harmonics() > 0;
  const char* meaning = harmonics ? "all channels; the constant term of the harmonics"
                                  : "all channels; not clamped in training";
  out.add(
      {"colour", "colour value; screens show 0 to 1", meaning, false, false, {}},
      [](Layout l) {
        return Rows{l.rgb, 3};
      },
      [harmonics](double raw) { return harmonics ? 0.5 + kConstantHarmonic * raw : raw; });
}

}  // namespace

std::vector<SplatQuantity> splat_quantities(const MixedModel& model) {
  Collector out(model);
  const ModelVariant& variant = model.variant();
  out.add(
      {"opacity", "base opacity", "opacity before direction and time reduce it", false, true, {}},
      [](Layout l) {
        return Rows{l.opacity, 1};
      },
      sigmoid);
  add_scales(out, variant);
  add_betas(out, variant);
  add_colours(out, variant);
  out.add(
      {"time mean", "time, 0 to 1", "position of the splats in time", false, false, {}},
      [](Layout l) { return shifted(l.mean, time(l)); }, unchanged);
  return out.take();
}

}  // namespace ubs
