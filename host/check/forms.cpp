// SPDX-License-Identifier: Apache-2.0
#include "host/check/forms.hpp"

#include "host/base/error.hpp"

namespace ubs::check {
namespace {

std::vector<Form> make_forms() {
  std::vector<Form> all;
  for (int dim = 3; dim <= 11; ++dim) all.push_back({dim});
  const ModelVariant gs3{
      .rot_mode = RotMode::quaternion, .kernel = SpatialKernel::gaussian, .colour = ColourMode::sh3};
  const ModelVariant gs6{.cov_param = CovParam::cholesky,
                         .beta_cond = BetaCond::off,
                         .beta_opacity = BetaOpacity::gaussian,
                         .kernel = SpatialKernel::gaussian,
                         .colour = ColourMode::sh3,
                         .conditioning = Conditioning::direct};
  // Values of switches that select other formulas
  const std::vector<Form> shapes{
      {6, {.rot_mode = RotMode::exp}},          {6, {.cov_param = CovParam::cholesky}},
      {6, {.cov_param = CovParam::skew_nd}},    {6, {.beta_cond = BetaCond::off}},
      {6, {.beta_opacity = BetaOpacity::none}}, {6, {.beta_opacity = BetaOpacity::gaussian}},
      {6, {.cov_mode = CovMode::whiten}}};
  all.insert(all.end(), shapes.begin(), shapes.end());
  for (std::size_t kernel = 1; kernel < kSpatialKernels.size(); ++kernel)
    all.push_back({6, {.kernel = static_cast<SpatialKernel>(kernel)}});
  const std::vector<Form> others{{6, {.antialias = Antialias::on}},
                                 {6, {.conditioning = Conditioning::direct}},
                                 {6, {.colour = ColourMode::sb2}},
                                 {6, {.colour = ColourMode::sh1}},
                                 {6, {}, true},
                                 {7, {}, true},
                                 // Variants of the methods 3DGS, DBS and 6DGS
                                 {3, gs3},
                                 {3, {.rot_mode = RotMode::quaternion, .colour = ColourMode::sb2}},
                                 {6, gs6}};
  all.insert(all.end(), others.begin(), others.end());
  return all;
}

// Returns the number of switches that have the same value in both forms.
int agreeing(const Form& a, const Form& b) {
  const auto x = variant_numbers(a.variant), y = variant_numbers(b.variant);
  int count = a.query_grad == b.query_grad;
  for (std::size_t i = 0; i < x.size(); ++i) count += x[i] == y[i];
  return count;
}

}  // namespace

const std::vector<Form>& forms() {
  static const std::vector<Form> all = make_forms();
  return all;
}

std::size_t nearest_form(const Form& form) {
  const std::vector<Form>& all = forms();
  std::size_t best = all.size();
  for (std::size_t i = 0; i < all.size(); ++i)
    if (all[i].dim == form.dim && (best == all.size() || agreeing(all[i], form) > agreeing(all[best], form)))
      best = i;
  if (best == all.size())
    fail(ErrorKind::internal, "the device check has no reference data for N = {}", form.dim);
  return best;
}

}  // namespace ubs::check
