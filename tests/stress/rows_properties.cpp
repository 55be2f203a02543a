// SPDX-License-Identifier: Apache-2.0
// This file tests two properties of all models: the order of the splats does not matter, and with cov_mode =
// whiten, no projected covariance is indefinite. judge.cpp checks other properties in every case: pixels are
// within the range of the colours, gradients are finite, gradients of culled splats are zero, and all other
// gradients agree with float64.
#include <catch2/catch.hpp>
#include <cmath>

#include "host/base/error.hpp"
#include "host/lab/oracle/frame.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "tests/stress/row.hpp"

namespace ubs::stress {
namespace {

Case permuted(const Case& c, const std::vector<std::size_t>& order) {
  Case result = c;
  for (int row = 0; row < c.model.layout().count; ++row)
    for (std::size_t i = 0; i < order.size(); ++i) result.model.row(row)[i] = c.model.row(row)[order[i]];
  return result;
}

// Changes a few splats to needles, and gives every second splat small query scales and conditioning weights
// below 1. Kernels process several splats at once as a vector. If the splats are reordered, other splats
// share a vector with a needle.
void stiffen(Case& c) {
  const ParameterLayout& layout = c.model.layout();
  for (std::size_t i = 0; i < c.model.count; ++i) {
    if (i % 35 == 0) c.model.row(layout.scale)[i] = -14;
    if (i % 2 == 0) continue;
    for (int k = 0; k < layout.query; ++k) {
      double square = 0;
      for (int j = 0; j < 3 + k; ++j) {
        const float entry = c.model.row(layout.l_triangle + (3 + k) * (2 + k) / 2 + j)[i];
        square += static_cast<double>(entry) * entry;
      }
      const double scale = 0.01 * std::sqrt(square) + 1e-6;
      c.model.row(layout.scale + 3 + k)[i] = static_cast<float>(std::log(std::expm1(scale)));
      c.model.row(layout.query_beta + k)[i] = -0.5f;
    }
  }
}

// All depths differ, so reordering the splats must give a bit-identical image, and the same gradients in the
// new order.
TEST_CASE_METHOD(Row, "order: reordering the splats changes no bit of the image and the gradients",
                 "[property]") {
  Random random(11);
  for (const int dim : kRowDims)
    for (std::uint64_t seed = 0; seed < 4; ++seed) {
      INFO("N = " << dim << ", seed " << seed);
      Case c = ordinary_case("order", dim, 70, seed);
      if (seed % 2 == 1) stiffen(c);
      std::vector<std::size_t> order(c.model.count);
      for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
      for (std::size_t i = order.size(); i-- > 1;) std::swap(order[i], order[random.bits() % (i + 1)]);
      const std::vector<float> weights = pixel_weights(c);
      const DeviceResult a = runner().run(c, weights), b = runner().run(permuted(c, order), weights);
      CHECK(same_bits(a.image, b.image));
      bool equal = true;
      for (int row = 0; row < c.model.layout().count; ++row)
        for (std::size_t i = 0; i < order.size(); ++i)
          equal = equal && b.gradient.row(row)[i] == a.gradient.row(row)[order[i]];
      CHECK(equal);
    }
}

// Returns a case with random splats whose positions are strongly coupled to the query. All splats are in the
// image. With cov_mode = upper, the projected covariances of some of them may be indefinite.
Case coupled_case(int dim, CovMode mode, std::uint64_t seed) {
  Case c = row_case("coupled", dim, 200, {.cov_mode = mode});
  Random random(seed);
  for (std::size_t i = 0; i < c.model.count; ++i) {
    SplatPlan plan;
    const double z = random.uniform(2, 4);
    plan.position = {0.3 * z * random.uniform(-1, 1), 0.3 * z * random.uniform(-1, 1), z};
    plan.coupling = std::exp(random.uniform(-1, 1.5));
    // The scales are large compared with eps2d. Otherwise, adding eps2d could make an indefinite covariance
    // definite.
    plan.scale = {2, 2, 2};
    put_splat(c, i, plan);
    const ParameterLayout l = c.model.layout();
    for (int row = l.query_beta; row < l.mean; ++row)
      c.model.row(row)[i] = static_cast<float>(random.uniform(-4, 0));
  }
  return c;
}

TEST_CASE_METHOD(Row, "definiteness: whitened covariances of strongly coupled models are definite",
                 "[property]") {
  for (const int dim : {5, 6, 7})
    for (const CovMode mode : {CovMode::whiten, CovMode::upper}) {
      const Case c = coupled_case(dim, mode, static_cast<std::uint64_t>(dim));
      oracle::Options options;
      options.variant = c.model.variant;
      const oracle::Frame frame(oracle::to_model(c.model), c.camera, options);
      std::size_t indefinite = 0;
      for (const oracle::Footprint<double>& f : frame.culled) indefinite += f.in_range;
      INFO("N = " << dim);
      if (mode == CovMode::whiten) CHECK(indefinite == 0);
      check_case(c);
    }
}

}  // namespace
}  // namespace ubs::stress
