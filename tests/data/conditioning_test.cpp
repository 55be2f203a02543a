// SPDX-License-Identifier: Apache-2.0
// Tests the conversion of models between covariance conditioning and direct conditioning. The tests compare
// the splats before and after a conversion, for several views. The oracle, which is the reference
// implementation in float64, computes these splats.
#include "host/scene/conditioning.hpp"

#include <algorithm>
#include <catch2/catch.hpp>

#include "host/lab/oracle/scenes.hpp"
#include "host/lab/oracle/splat_formula.hpp"
#include "tests/support/temp_folder.hpp"
#include "tests/support/variants.hpp"

namespace ubs {
namespace {

using oracle::Conditioned;

SplatModel scene_model(int dim, const ModelVariant& variant) {
  return oracle::regular_scene(
             {.count = 60, .dim = dim, .seed = 5, .width = 32, .height = 24, .variant = variant})
      .model;
}

Conditioned<double> seen(const SplatModel& model, std::size_t splat, int view) {
  const oracle::SceneOptions options{.dim = model.dim, .width = 32, .height = 24};
  std::vector<double> raw;
  for (int r = 0; r < model.layout().count; ++r) raw.push_back(model.row(r)[splat]);
  oracle::Options drawing;
  drawing.variant = model.variant;
  return oracle::condition<double>(raw, oracle::Rows(model.dim, model.variant), ring_camera(options, view),
                                   drawing);
}

struct Difference {
  // The largest differences. `mean` is relative to the size of the splat, `covariance` is relative to the
  // square of the size, and `opacity` is absolute.
  double mean = 0, covariance = 0, opacity = 0;
  int compared = 0;
};

Difference difference(const SplatModel& a, const SplatModel& b) {
  Difference d;
  for (std::size_t i = 0; i < a.count; ++i)
    for (int view = 0; view < 3; ++view) {
      const Conditioned<double> x = seen(a, i, view), y = seen(b, i, view);
      const oracle::Matrix<double> v = oracle::symmetric(x.covariance), w = oracle::symmetric(y.covariance);
      // Only splats with a positive definite covariance can be converted.
      const oracle::Matrix<double> factor = oracle::cholesky(v);
      if (!std::isfinite(factor(2, 2))) continue;
      const double square = v(0, 0) + v(1, 1) + v(2, 2);
      for (std::size_t k = 0; k < 3; ++k)
        d.mean = std::max(d.mean, std::abs(x.mean[k] - y.mean[k]) / std::sqrt(square));
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
          d.covariance = std::max(d.covariance, std::abs(v(r, c) - w(r, c)) / square);
      d.opacity = std::max(d.opacity, std::abs(x.opacity - y.opacity));
      ++d.compared;
    }
  return d;
}

// The errors come from rounding the parameters to float32.
void check_kept(const Difference& d) {
  CHECK(d.mean < 6.6e-7);        // worst observed 3.4e-7
  CHECK(d.covariance < 4.5e-7);  // worst observed 2.3e-7
}

const ModelVariant kGaussian{
    .beta_cond = BetaCond::off, .beta_opacity = BetaOpacity::gaussian, .kernel = SpatialKernel::gaussian};

TEST_CASE("conditioning: Gaussian models are converted to direct conditioning and back, up to rounding",
          "[conditioning]") {
  ModelVariant cholesky = kGaussian, weighted = kGaussian;
  cholesky.cov_param = CovParam::cholesky;  // as in 6DGS and 7DGS
  weighted.beta_cond = BetaCond::on;
  weighted.cov_mode = CovMode::whiten;
  weighted.colour = ColourMode::sh1;
  for (const int dim : {4, 6, 7, 11})
    for (const ModelVariant& variant : {kGaussian, cholesky, weighted}) {
      INFO(dim << " " << to_string(variant));
      const SplatModel model = scene_model(dim, variant);
      const Reconditioned there = to_direct(model);
      CHECK(there.model.variant.direct());
      CHECK(there.opacity_most == 0);
      CHECK(there.indefinite == 0);
      const Reconditioned back = to_covariance(there.model);
      CHECK(!back.model.variant.direct());
      for (const SplatModel* other : {&there.model, &back.model}) {
        const Difference d = difference(model, *other);
        CHECK(d.compared == 180);
        check_kept(d);
        CHECK(d.opacity < 3.5e-8);  // worst observed 1.8e-8
      }
    }
}

TEST_CASE("conditioning: only the opacity of Beta models changes, and the change is reported",
          "[conditioning]") {
  for (const int dim : {4, 6, 7})
    for (const CovMode mode : {CovMode::upper, CovMode::whiten}) {
      INFO(dim << " " << static_cast<int>(mode));
      SplatModel model = scene_model(dim, {.cov_mode = mode});
      const Reconditioned there = to_direct(model);
      const Difference d = difference(model, there.model);
      CHECK(d.compared > 90);
      check_kept(d);
      CHECK((there.opacity_most > 1e-3) == (dim > 4));
      CHECK((d.opacity > 1e-3) == (dim > 4));
      // If the query dimensions are not correlated, the opacity does not change either.
      const ParameterLayout l = model.layout();
      for (int row = l.l_triangle + 3; row < l.count; ++row) std::ranges::fill(model.row(row), 0.0f);
      const Reconditioned same = to_direct(model);
      CHECK(same.opacity_most < 1e-9);
      CHECK(difference(model, same.model).opacity < 3.5e-8);
    }
}

TEST_CASE("conditioning: a direct Beta model is converted to covariance conditioning if this is possible",
          "[conditioning]") {
  const ModelVariant direct{.conditioning = Conditioning::direct};
  SplatModel model = scene_model(6, direct);
  const ParameterLayout l = model.layout();
  for (int q = 3; q < 6; ++q)
    for (int c = 0; c < 3; ++c)
      for (float& theta : model.row(l.l_triangle + q * (q - 1) / 2 + c)) theta *= 0.1f;
  for (int q = 0; q < l.query; ++q)  // makes the weights similar
    for (float& b : model.row(l.query_beta + q)) b = -0.2f + 0.02f * b;
  const Difference d = difference(model, to_covariance(model).model);
  CHECK(d.compared == 180);
  check_kept(d);
  CHECK(d.opacity > 1e-3);
  for (int q = 0; q < l.query; ++q)
    for (float& b : model.row(l.query_beta + q)) b = q == 1 ? -6.0f : 0.0f;
  for (int row = l.l_triangle + 3; row < l.count; ++row)
    for (float& entry : model.row(row)) entry *= 30;
  CHECK_THROWS_WITH(to_covariance(model), Catch::Contains("cannot be represented by a covariance"));
  model.variant = {};  // the same numbers, interpreted as a covariance
  const Reconditioned indefinite = to_direct(model);
  CHECK(indefinite.indefinite > 0);
  CHECK(std::ranges::all_of(indefinite.model.values, [](float x) { return std::isfinite(x); }));
}

TEST_CASE("conditioning: models that cannot be converted are rejected", "[conditioning]") {
  CHECK_THROWS_WITH(to_covariance(scene_model(6, {})), Catch::Contains("does not have direct conditioning"));
  CHECK_THROWS_WITH(to_direct(scene_model(6, {.conditioning = Conditioning::direct})),
                    Catch::Contains("already"));
  CHECK_THROWS_WITH(to_direct(scene_model(6, {.cov_param = CovParam::skew_nd})), Catch::Contains("skew_nd"));
  CHECK_THROWS_WITH(SplatModel(6, 1, {.cov_mode = CovMode::whiten, .conditioning = Conditioning::direct}),
                    Catch::Contains("conditioning = direct"));
}

}  // namespace
}  // namespace ubs
