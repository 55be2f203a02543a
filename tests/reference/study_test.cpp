// SPDX-License-Identifier: Apache-2.0
// Tests the limits of parameters in the oracle, and study(), which marks pixels as undecided if rounding may
// put a splat on either side of a threshold.
#include "host/lab/oracle/study.hpp"

#include <catch2/catch.hpp>
#include <cmath>

#include "host/lab/oracle/scenes.hpp"
#include "host/lab/oracle/splat_formula.hpp"

namespace ubs::oracle {
namespace {

// One is a model with one splat in front of a camera at the origin. The raw spatial scales of the splat are
// above 20, where softplus is the identity. So the scales are exactly 24, and the splat has a radius of 2
// pixels.
struct One {
  explicit One(int dim) : rows(dim) {
    model.dim = dim, model.count = 1;
    model.values.assign(static_cast<std::size_t>(rows.count), 0.0);
    camera.fx = camera.fy = 8;
    camera.width = camera.height = 25;
    camera.cx = camera.cy = 12.5;
    model.values[2] = 96;
    for (int i = 0; i < 3; ++i) model.values[static_cast<std::size_t>(rows.scale + i)] = 24;
    for (int i = 0; i < rows.query; ++i) model.values[static_cast<std::size_t>(rows.scale + 3 + i)] = 1;
    if (rows.query >= 3) model.values[static_cast<std::size_t>(rows.mean + 2)] = 1;  // the view direction
    options.eps2d = 0;
  }
  double& at(int row) { return model.values[static_cast<std::size_t>(row)]; }
  Study study(double margin = 32) const {
    StudyOptions how;
    how.margin = margin;
    return oracle::study(model, camera, std::vector<double>(3 * 25 * 25, 1.0), options, how);
  }
  Rows rows;
  Model model;
  Camera camera;
  Options options;
};

TEST_CASE("a query scale is raised to a fraction of its row, and a row of zeros is reported",
          "[oracle][study]") {
  One one(5);
  one.camera.extra = {0.25};
  one.camera.time = 1e-9;
  for (const int q : {3, 4}) {
    one.at(one.rows.scale + q) = -40;                   // a query scale of about 4e-18
    one.at(one.rows.triangle + q * (q - 1) / 2) = 0.5;  // both rows point along x
  }
  const Footprint<double> lifted = footprint<double>(one.model.values, one.rows, one.camera, one.options);
  CHECK(std::isfinite(lifted.mean[0]));
  CHECK_FALSE(lifted.guards.pivot);
  for (const int q : {3, 4}) one.at(one.rows.scale + q) = std::log(std::expm1(least_query_scale({}) * 0.5));
  const Footprint<double> least = footprint<double>(one.model.values, one.rows, one.camera, one.options);
  CHECK(lifted.mean[0] == Approx(least.mean[0]).epsilon(1e-12));
  CHECK(lifted.opacity == Approx(least.opacity).epsilon(1e-12));
  CHECK(least.guards.kink);  // the scale is at its limit, so the derivative of either side is correct
  for (const int q : {3, 4}) {
    one.at(one.rows.scale + q) = -200;
    one.at(one.rows.triangle + q * (q - 1) / 2) = 0;
  }
  CHECK(footprint<double>(one.model.values, one.rows, one.camera, one.options).guards.pivot);
}

TEST_CASE("clamped parameters have the derivative of the clamped function", "[oracle][study]") {
  Tape tape;
  const Rows rows(4);
  std::vector<Var> raw;
  for (int k = 0; k < rows.count; ++k) raw.push_back(Var::input(tape, 0.1));
  raw[rows.scale + 3] = Var::input(tape, -20);
  const Matrix<Var> factor = covariance_factor<Var>(raw, rows);
  CHECK(factor(3, 3).value() == Approx(least_query_scale({}) * std::sqrt(3 * 0.01)));
  tape.seed(factor(3, 3).node(), 1);
  tape.reverse();
  CHECK(tape.adjoint(raw[rows.scale + 3].node()) == 0);
  for (int k = 0; k < 3; ++k)  // d |row| / d row = row / |row|
    CHECK(tape.adjoint(raw[rows.triangle + 3 + k].node()) == Approx(least_query_scale({}) / std::sqrt(3.0)));
}

TEST_CASE("a spatial scale far below the largest scale is raised to a fraction of it", "[oracle][study]") {
  Tape tape;
  const Rows rows(3);
  std::vector<Var> raw;
  for (int k = 0; k < rows.count; ++k) raw.push_back(Var::input(tape, 0));
  raw[rows.scale] = Var::input(tape, 30), raw[rows.scale + 2] = Var::input(tape, -20);
  const Matrix<Var> factor = covariance_factor<Var>(raw, rows);
  CHECK(factor(1, 1).value() == Approx(std::log(2.0)));
  CHECK(factor(2, 2).value() == Approx(30e-4));
  tape.seed(factor(2, 2).node(), 1);
  tape.reverse();
  CHECK(tape.adjoint(raw[rows.scale + 2].node()) == 0);
  CHECK(tape.adjoint(raw[rows.scale].node()) == Approx(1e-4));
}

TEST_CASE("lower_orthogonal() gives the same factor as a Cholesky factorisation", "[oracle][study]") {
  Random random(5);
  Matrix<double> b(3, 6);
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 6; ++k) b(i, k) = random.uniform(-1, 1);
  const LowerOrthogonal<double> lq = lower_orthogonal(b);
  const Matrix<double> product = lq.lower * lq.rows, sigma = b * b.transposed(), chol = cholesky(sigma);
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 6; ++k) CHECK(product(i, k) == Approx(b(i, k)).margin(1e-14));
    for (int j = 0; j <= i; ++j) CHECK(lq.lower(i, j) == Approx(chol(i, j)).margin(1e-13));
  }
  CHECK_FALSE(lq.floored);
}

TEST_CASE("without its floor, the tanh factor is limited at u = 1e4", "[oracle][study]") {
  CHECK(log_query_factor<double>(1e3, false) == Approx(std::log(2.0) - 2e4));
  CHECK(log_query_factor<double>(50, false) == Approx(std::log(2.0) - 5000));
  CHECK(log_query_factor<double>(1e3, true) == Approx(-23 * std::log(2.0)));
}

TEST_CASE("the rotation of a quaternion of length 0 is the identity, and is continuous", "[oracle][study]") {
  const Matrix<double> r = quaternion_rotation<double>({0.0, 0.0, 0.0, 0.0});
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) CHECK(r(i, j) == (i == j ? 1.0 : 0.0));
  // The rotation has one definition for very short quaternions and another one for all others. They must
  // agree at the length that separates them.
  const double half = 0.5e-12;
  const Matrix<double> below = quaternion_rotation<double>({half, half, half, half * (1 - 1e-12)});
  const Matrix<double> above = quaternion_rotation<double>({half, half, half, half * (1 + 1e-9)});
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) CHECK(below(i, j) == Approx(above(i, j)).margin(1e-8));
}

TEST_CASE("pixels on the rim of a splat are undecided, unless the margin is 0", "[oracle][study]") {
  One one(3);  // has a radius of 2 pixels around a pixel centre, so four other centres are exactly on the rim
  one.at(one.rows.beta) = -3;
  const Study s = one.study();
  CHECK(s.undecided_pixels == 4);
  CHECK(s.undecided[12 * 25 + 14] == 1);
  CHECK(one.study(0).undecided_pixels == 0);
  one.at(one.rows.beta) = 2;  // alpha falls to 0 at the rim, so it does not matter on which side a pixel is
  CHECK(one.study().undecided_pixels == 0);
}

TEST_CASE("undecided pixels do not contribute to the gradient", "[oracle][study]") {
  One one(3);
  one.at(one.rows.beta) = -3;
  for (int i = 0; i < 3; ++i) one.at(one.rows.scale + i) *= 1 + 1e-9;  // puts four pixels just inside the rim
  const std::vector<double> weights(3 * 25 * 25, 1.0);
  const std::vector<double> all = weighted_gradient(one.model, one.camera, weights, one.options);
  const Study s = one.study();
  CHECK(s.gradient != all);
  CHECK(one.study(0).gradient == all);
}

TEST_CASE("a pixel is undecided if rounding determines whether alpha is limited", "[oracle][study]") {
  One one(3);
  one.at(one.rows.opacity) = std::log(0.999 / 0.001);  // alpha = 0.999 at the centre
  CHECK(one.study().undecided[12 * 25 + 12] == 1);
  one.at(one.rows.opacity) = std::log(0.998 / 0.002);
  CHECK(one.study().undecided[12 * 25 + 12] == 0);
}

TEST_CASE("a splat is undecided if only rounding separates it from the near plane", "[oracle][study]") {
  One one(3);
  one.options.near_plane = 96 * (1 + 1e-7);
  CHECK(one.study().undecided_splats == 1);
  CHECK(one.study().undecided_pixels == 25 * 25);
  one.options.near_plane = 96.1;
  const Study culled = one.study();
  CHECK(culled.undecided_splats == 0);
  CHECK(culled.culled[0] == 1);
}

TEST_CASE("nearly equal depths make the order of splats undecided, equal depths do not", "[oracle][study]") {
  const auto undecided = [](double shift) {
    One one(3);
    Model two = one.model;
    two.count = 2, two.values.clear();
    for (std::size_t r = 0; r < one.model.values.size(); ++r) {
      two.values.push_back(one.model.values[r]);
      two.values.push_back(one.model.values[r] + (r == 2 ? shift : r == 3 ? 0.5 : 0));
    }
    return study(two, one.camera, std::vector<double>(3 * 25 * 25, 1.0), one.options, {})
        .undecided[12 * 25 + 13];
  };
  CHECK(undecided(0) == 0);
  CHECK(undecided(1e-6) == 1);
  CHECK(undecided(0.1) == 0);
}

TEST_CASE("rounding the inputs changes the image by about the rounding error of float", "[oracle][study]") {
  const Scene scene = regular_scene({.count = 40, .dim = 6, .seed = 3, .width = 24, .height = 18});
  const std::vector<double> weights(3 * 24 * 18, 1.0);
  const Study s = study(to_model(scene.model), scene.camera, weights, {.background = scene.background}, {});
  REQUIRE(s.neighbours.size() == 2);
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < s.image.image.size(); ++i) {
    if (s.undecided[i % (24 * 18)]) continue;
    difference += std::pow(s.neighbours[0].image[i] - s.image.image[i], 2),
        size += std::pow(s.image.image[i], 2);
  }
  CHECK(std::sqrt(difference / size) > 1e-9);
  CHECK(std::sqrt(difference / size) < 1e-5);
}

}  // namespace
}  // namespace ubs::oracle
