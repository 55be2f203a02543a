// SPDX-License-Identifier: Apache-2.0
// Tests the oracle itself: compares its gradient with central differences of its own loss, and its formulas
// with closed forms, limits and a second evaluation. The oracle uses only one part of the code that is tested
// against it: the layout of the parameters.
#include "host/lab/oracle/oracle.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <numeric>
#include <string>
#include <vector>

#include "host/lab/oracle/scenes.hpp"
#include "host/lab/oracle/splat_formula.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::oracle {
namespace {

Options options_of(const Scene& scene) {
  Options options;
  options.background = scene.background;
  return options;
}

double norm(const std::vector<double>& v) {
  return std::sqrt(std::inner_product(v.begin(), v.end(), v.begin(), 0.0));
}

double relative_error(const std::vector<double>& got, const std::vector<double>& want) {
  std::vector<double> difference(got.size());
  for (std::size_t i = 0; i < got.size(); ++i) difference[i] = got[i] - want[i];
  return norm(difference) / std::max(norm(want), 1e-300);
}

std::vector<double> group_values(const std::vector<double>& values, const ParameterGroup& group,
                                 std::size_t count) {
  return {values.begin() + static_cast<std::ptrdiff_t>(group.first * count),
          values.begin() + static_cast<std::ptrdiff_t>((group.first + group.count) * count)};
}

// Returns the image plus an offset of at least 0.05 in smooth patches of both signs, so that no argument of
// |.| changes its sign for a small step.
std::vector<double> target_away_from(const std::vector<double>& image) {
  std::vector<double> target = image;
  for (std::size_t i = 0; i < target.size(); ++i) {
    const double wave = std::sin(0.05 * static_cast<double>(i));
    target[i] += wave < 0 ? -0.05 + 0.2 * wave : 0.05 + 0.2 * wave;
  }
  return target;
}

// Returns the gradient of the loss for the parameters of a group, by central differences with the five-point
// formula. With a smaller step, rounding of the loss would dominate. With a larger step, the steep rim of
// splats with beta < 1 would give large errors: with this step, the two-point formula already has an error of
// 3e-5.
std::vector<double> central_differences(Model model, const Camera& camera, const std::vector<double>& target,
                                        const Options& options, const ParameterGroup& group) {
  constexpr double kStep = 1e-5;
  std::vector<double> result;
  for (std::size_t i = group.first * model.count; i < (group.first + group.count) * model.count; ++i) {
    const double x = model.values[i];
    const auto difference = [&](double h) {
      model.values[i] = x + h;
      const double up = loss(model, camera, target, options);
      model.values[i] = x - h;
      return up - loss(model, camera, target, options);
    };
    result.push_back((8 * difference(kStep) - difference(2 * kStep)) / (12 * kStep));
    model.values[i] = x;
  }
  return result;
}

// Returns the relative 2-norm error of every parameter group, without empty groups (query means of N = 3).
std::map<std::string, double> gradient_errors(const Scene& scene, const Options& options) {
  const Model model = to_model(scene.model);
  const std::vector<double> target = target_away_from(render(model, scene.camera, options).image);
  const Gradient g = gradient(model, scene.camera, target, options);
  std::map<std::string, double> errors;
  for (const ParameterGroup& group : parameter_groups(ParameterLayout(model.dim))) {
    if (group.count == 0) continue;
    const std::vector<double> exact = group_values(g.values, group, model.count);
    REQUIRE(norm(exact) > 1e-6);
    errors[group.name] =
        relative_error(exact, central_differences(model, scene.camera, target, options, group));
  }
  return errors;
}

// Returns the sum of all values.
double column_sum(const std::vector<double>& v) { return std::accumulate(v.begin(), v.end(), 0.0); }

std::vector<double> raw_of(const Model& model, std::size_t splat) {
  std::vector<double> raw;
  for (std::size_t i = splat; i < model.values.size(); i += model.count) raw.push_back(model.values[i]);
  return raw;
}

double max_difference(const Matrix<double>& a, const Matrix<double>& b) {
  double worst = 0;
  for (int i = 0; i < a.rows(); ++i)
    for (int j = 0; j < a.columns(); ++j) worst = std::max(worst, std::abs(a(i, j) - b(i, j)));
  return worst;
}

}  // namespace

TEST_CASE("the oracle and ubs use the same order of parameter rows", "[oracle]") {
  for (int dim = 3; dim <= 11; ++dim) {
    const Rows rows(dim);
    const ParameterLayout layout(dim);
    CHECK(rows.mean == layout.mean);
    CHECK(rows.scale == layout.scale);
    CHECK(rows.triangle == layout.l_triangle);
    CHECK(rows.count == layout.count);
    CHECK(rows.beta == layout.beta);
  }
}

// The scenes have 22 splats. One of them reaches the maximum alpha, one has a query factor below its floor,
// and one is outside the field of view in which the projection is linearised at the position of the splat.
TEST_CASE("the gradient of the oracle equals central differences in every parameter group", "[oracle]") {
  for (int dim : {3, 4, 6, 7, 11}) {
    const Scene scene = regular_scene({22, dim, 7, 16, 12});
    Options options = options_of(scene);
    options.query_grad = true;  // moving a splat also changes the view direction in the loss
    for (const auto& [name, error] : gradient_errors(scene, options)) {
      CAPTURE(dim, name);
      // The largest error observed is 2.4e-8, for l_triangle with N = 11 (g++ 12 -O2).
      CHECK(error < 5e-8);
    }
  }
}

TEST_CASE("the gradient check fails on a gradient scaled by 1.001", "[oracle]") {
  const Scene scene = regular_scene({12, 6, 7, 24, 18});
  const Options options = options_of(scene);
  const Model model = to_model(scene.model);
  const std::vector<double> target = target_away_from(render(model, scene.camera, options).image);
  std::vector<double> wrong = gradient(model, scene.camera, target, options).values;
  const ParameterGroup scale = parameter_groups(ParameterLayout(6))[5];
  std::vector<double> part = group_values(wrong, scale, model.count);
  for (double& x : part) x *= 1.001;
  CHECK(relative_error(part, central_differences(model, scene.camera, target, options, scale)) > 5e-4);
}

TEST_CASE("query_grad only adds the gradient through the view direction to that of positions", "[oracle]") {
  for (int dim : {6, 7, 11}) {
    const Scene scene = regular_scene({20, dim, 3, 32, 24});
    const Model model = to_model(scene.model);
    Options options = options_of(scene);
    const std::vector<double> off = gradient(model, scene.camera, scene.target, options).values;
    options.query_grad = true;
    const std::vector<double> on = gradient(model, scene.camera, scene.target, options).values;
    const std::size_t n = model.count;
    const Rows rows(dim);
    const std::array<double, 3> centre = camera_centre(scene.camera);
    double added = 0;
    for (std::size_t p = 0; p < n; ++p) {
      std::array<double, 3> w{}, g{};
      double square = 0, along = 0;
      for (int k = 0; k < 3; ++k) w[k] = model.values[k * n + p] - centre[k], square += w[k] * w[k];
      for (int k = 0; k < 3; ++k) g[k] = -off[(rows.mean + k) * n + p], along += g[k] * w[k] / square;
      for (int k = 0; k < 3; ++k) {
        const double want = (g[k] - along * w[k]) / std::sqrt(square);
        CHECK(on[k * n + p] - off[k * n + p] ==
              Approx(want).epsilon(0).margin(3e-18));  // the error is 1.5e-18 with FMA, 5.4e-19 without
        added += std::abs(want);
      }
    }
    CHECK(added > 1e-4);
    const auto tail = [n](const std::vector<double>& v) {
      return std::vector<double>(v.begin() + 3 * static_cast<std::ptrdiff_t>(n), v.end());
    };
    CHECK(relative_error(tail(on), tail(off)) < 6.6e-16);  // the error is 3.3e-16 with FMA, 0 without
  }
}

TEST_CASE("the values of cameras and targets of scenes can be represented as float", "[oracle]") {
  const auto check = [](double x) {
    const volatile float rounded = static_cast<float>(x);  // `volatile` makes the compiler round
    CHECK(x == static_cast<double>(rounded));
  };
  for (int dim : {3, 5, 6})
    for (int index = 0; index < kRingCameras; ++index) {
      const Camera camera = ring_camera({200, dim, 1, 64, 48}, index);
      for (double x : camera.rotation) check(x);
      for (double x : camera.translation) check(x);
      for (double x : {camera.fx, camera.fy, camera.cx, camera.cy, camera.time}) check(x);
      for (double x : camera.extra) check(x);
    }
  const Scene scene = opaque_stack_scene({200, 6, 1, 64, 48});
  for (double x : scene.background) check(x);
  for (double x : scene.target) check(x);
}

TEST_CASE("regular scenes contain splats at the limits of alpha, projection and query factor", "[oracle]") {
  for (int dim : {3, 4, 6, 7, 11}) {
    CAPTURE(dim);
    const Scene scene = regular_scene({200, dim, 1, 64, 48});
    const Model model = to_model(scene.model);
    const Options options = options_of(scene);
    const Render image = render(model, scene.camera, options);
    CHECK(image.visible > 150);
    CHECK(image.visible < 200);  // some splats are behind the camera
    CHECK(column_sum(image.alpha) > 0.25 * static_cast<double>(image.alpha.size()));
    const int contributors = std::accumulate(image.contributors.begin(), image.contributors.end(), 0);
    CHECK(contributors > 4 * static_cast<int>(image.alpha.size()));

    const Rows rows(dim);
    int clamped = 0, beyond = 0, floored = 0;
    for (std::size_t i = 0; i < model.count; ++i) {
      const std::vector<double> raw = raw_of(model, i);
      const Footprint<double> f = footprint<double>(raw, rows, scene.camera, options);
      if (!f.visible) continue;
      clamped += f.opacity > kMaxAlpha;
      beyond += f.mean[0] > 1.15 * scene.camera.width && f.opacity > 1e-3;
      if (dim == 3) continue;
      std::vector<double> x = query_vector<double>(raw, rows, scene.camera, false);
      for (int k = 0; k < rows.query; ++k) x[k] -= raw[rows.mean + k];
      const Matrix<double> l = covariance_factor<double>(raw, rows), s = l * l.transposed();
      const double y = forward_substitution<double>(cholesky(s.block(3, 3, rows.query, rows.query)), x)[0];
      floored += log_query_factor(y) < -15.9423 && f.opacity > 1e-3;
    }
    CHECK(clamped > 0);
    CHECK(beyond > 0);
    CHECK((dim == 3 || floored > 0));

    const Gradient g = gradient(model, scene.camera, scene.target, options);
    CHECK(g.loss == Approx(loss(model, scene.camera, scene.target, options)).epsilon(1e-14));
    for (const ParameterGroup& group : parameter_groups(ParameterLayout(dim)))
      if (group.count > 0) CHECK(norm(group_values(g.values, group, model.count)) > 1e-6);
    CHECK(std::all_of(g.values.begin(), g.values.end(), [](double x) { return std::isfinite(x); }));
  }
}

TEST_CASE("the entries of l_triangle are at the expected places of the factor and the rotation", "[oracle]") {
  const Rows rows(6);
  std::vector<double> raw(rows.count, 0.0);
  for (int k = 0; k < 15; ++k) raw[rows.triangle + k] = k + 1;
  const Matrix<double> l = covariance_factor<double>(raw, rows);
  CHECK(l(3, 0) == 4);   // entry 3 = Lqx[0][0]
  CHECK(l(4, 0) == 7);   // entry 6 = Lqx[1][0]
  CHECK(l(4, 3) == 10);  // entry 9 = Lq[1][0]
  CHECK(l(5, 0) == 11);  // entry 10 = Lqx[2][0]
  CHECK(l(5, 3) == 14);  // entry 13 = Lq[2][0]
  CHECK(l(5, 4) == 15);  // entry 14 = Lq[2][1]
  CHECK(l(0, 3) == 0);
  const Matrix<double> r = skew_rotation(skew<double>(raw, rows, 3), RotMode::taylor1);
  CHECK((r(0, 1) == 1 && r(0, 2) == 2 && r(1, 2) == 3 && r(1, 0) == -1 && r(2, 0) == -2 && r(2, 1) == -3));
  const double det = r(0, 0) * (r(1, 1) * r(2, 2) - r(1, 2) * r(2, 1)) -
                     r(0, 1) * (r(1, 0) * r(2, 2) - r(1, 2) * r(2, 0)) +
                     r(0, 2) * (r(1, 0) * r(2, 1) - r(1, 1) * r(2, 0));
  CHECK(det == Approx(1 + 1 + 4 + 9).epsilon(1e-14));
}

TEST_CASE("query betas of 0 give the Schur complement as the conditional covariance", "[oracle]") {
  for (int dim : {4, 6, 7, 11}) {
    Scene scene = regular_scene({16, dim, 5, 32, 24});
    Model model = to_model(scene.model);
    const Rows rows(dim);
    const int c = rows.query;
    for (std::size_t i = rows.beta * model.count; i < rows.mean * model.count; ++i) model.values[i] = 0;
    for (std::size_t p = 0; p < model.count; ++p) {
      const std::vector<double> raw = raw_of(model, p);
      const Matrix<double> v = condition<double>(raw, rows, scene.camera, Options{}).covariance;
      // The largest difference observed is 2.1e-17, for values of up to 0.3.
      CHECK(max_difference(v, v.transposed()) < 1e-16);
      // The method uses the factorised form V = M K M^T with K = (I + Lqx^T (Lq Lq^T)^-1 Lqx)^-1.
      const Matrix<double> l = covariance_factor<double>(raw, rows);
      const Matrix<double> m = l.block(0, 0, 3, 3), lqx = l.block(3, 0, c, 3), lq = l.block(3, 3, c, c);
      Matrix<double> k_inverse = lqx.transposed() * inverse(lq * lq.transposed()) * lqx;
      for (int i = 0; i < 3; ++i) k_inverse(i, i) += 1;
      // The largest difference observed is 7.5e-17.
      CHECK(max_difference(v, m * inverse(k_inverse) * m.transposed()) < 1.5e-16);
    }
  }
}

TEST_CASE("splats without coupling at their query mean look like splats with N = 3", "[oracle]") {
  for (int dim : {4, 6, 7}) {
    const Scene scene = regular_scene({10, dim, 2, 32, 24});
    Model model = to_model(scene.model), flat{3, model.count, {}};
    const Rows rows(dim), flat_rows(3);
    flat.values.assign(flat_rows.count * flat.count, 0.0);
    for (std::size_t p = 0; p < model.count; ++p) {
      const auto at = [&](int row) -> double& { return model.values[row * model.count + p]; };
      for (int q = 3; q < dim; ++q)
        for (int k = 0; k < 3; ++k) at(rows.triangle + q * (q - 1) / 2 + k) = 0;
      const std::vector<double> q = query_vector<double>(raw_of(model, p), rows, scene.camera, false);
      for (int i = 0; i < rows.query; ++i) at(rows.mean + i) = q[i];
      for (int r = 0; r < 8; ++r) flat.values[r * flat.count + p] = at(r);
      for (int k = 0; k < 3; ++k) {
        flat.values[(flat_rows.scale + k) * flat.count + p] = at(rows.scale + k);
        flat.values[(flat_rows.triangle + k) * flat.count + p] = at(rows.triangle + k);
      }
    }
    const Options options = options_of(scene);
    const Render full = render(model, scene.camera, options), reduced = render(flat, scene.camera, options);
    CHECK(relative_error(full.image, reduced.image) < 1e-16);    // the error is 4.4e-17 with FMA, 0 without
    CHECK(relative_error(full.depth, reduced.depth) < 1.4e-15);  // the error is 7e-16 with FMA, 0 without
    CHECK(full.visible == reduced.visible);
    CHECK(full.visible > 0);
  }
}

TEST_CASE("the derivative for query betas of exactly 0 is the one for positive betas", "[oracle]") {
  const Scene scene = regular_scene({20, 6, 4, 32, 24});
  const Rows rows(6);
  const auto beta_gradient = [&](double b) {
    Model model = to_model(scene.model);
    for (std::size_t i = (rows.beta + 1) * model.count; i < rows.mean * model.count; ++i) model.values[i] = b;
    const Gradient g = gradient(model, scene.camera, scene.target, options_of(scene));
    return group_values(g.values, {"beta_q", rows.beta + 1, 3}, model.count);
  };
  const std::vector<double> at = beta_gradient(0), above = beta_gradient(1e-9), below = beta_gradient(-1e-9);
  CHECK(relative_error(at, above) < 1.6e-9);  // the error observed is 8e-10
  CHECK(relative_error(at, below) > 1e-3);
}

TEST_CASE("the logarithm of the query factor equals its direct formula and has a floor", "[oracle]") {
  for (double u : {0.0, 1e-8, 0.01, 0.3, 1.0, 2.5, 5.0, 8.0}) {
    const double direct = std::log1p(-std::tanh(u));  // sufficiently exact as long as 1 - tanh(u) > 1e-7
    // The largest observed difference is 2.5e-11, at u = 8. It is the error of the direct formula.
    CHECK(log_query_factor(std::sqrt(u)) == Approx(direct).epsilon(5e-11).margin(1e-15));
  }
  const double floor = std::log(1.1920928955078125e-7);
  CHECK(log_query_factor(std::sqrt(8.3177)) > floor);
  for (double u : {8.3179, 50.0, 1e4, 1e300})
    CHECK(log_query_factor(std::sqrt(u)) == Approx(floor).epsilon(1e-15));
  CHECK(std::exp(4 * std::exp(-5.0) * floor) == Approx(0.65).epsilon(0.01));

  Tape tape;  // at the floor, the derivative for y is 0, and the derivative for beta is the floor
  const Var y = Var::input(tape, 3.0), beta = Var::input(tape, 0.5);
  tape.seed((beta * log_query_factor(y)).node(), 1.0);
  tape.reverse();
  CHECK(tape.adjoint(y.node()) == 0.0);
  CHECK(tape.adjoint(beta.node()) == Approx(floor));
}

TEST_CASE("blending stops at a small transmittance, and the image is linear in the background", "[oracle]") {
  Scene scene = opaque_stack_scene({24, 6, 2, 18, 14});
  // With this beta, splats are smooth at their rim, so that central differences are accurate.
  for (std::size_t i = 0; i < scene.model.count; ++i) scene.model.values[7 * scene.model.count + i] = -0.2f;
  const Model model = to_model(scene.model);
  Options options = options_of(scene);
  options.query_grad = true;
  const Render image = render(model, scene.camera, options);
  const double most = *std::max_element(image.alpha.begin(), image.alpha.end());
  CHECK(most > 0.998);
  CHECK(most < 1 - 1e-4);  // the splat that would reach the limit is skipped

  int stopped = 0;
  for (std::size_t i = 0; i < image.alpha.size(); ++i) {
    int covering = 0;
    for (std::size_t p = 0; p < model.count; ++p) {
      const Footprint<double> f = footprint<double>(raw_of(model, p), Rows(6), scene.camera, options);
      covering += f.visible &&
                  kernel_radius(f, static_cast<double>(i % 18) + 0.5, static_cast<double>(i / 18) + 0.5) < 1;
    }
    stopped += image.contributors[i] < covering;
  }
  CHECK(stopped > 5);

  // The image is exactly linear in the background, with the final transmittance as the factor.
  Options white = options;
  for (double& b : white.background) b += 1;
  const Render bright = render(model, scene.camera, white);
  for (std::size_t i = 0; i < image.alpha.size(); ++i)
    CHECK(bright.image[i] - image.image[i] == Approx(1 - image.alpha[i]).epsilon(0).margin(5e-16));
  for (const auto& [name, error] : gradient_errors(scene, options)) {
    CAPTURE(name);
    // The largest error observed is 1.2e-7, for the query means, whose gradients are small.
    CHECK(error < 2.4e-7);
  }
}

TEST_CASE("the image of an isotropic splat agrees with its closed form", "[oracle]") {
  Camera camera;
  camera.width = 40, camera.height = 30;
  camera.fx = 50, camera.fy = 60, camera.cx = 17.5, camera.cy = 14.5;
  camera.translation = {0, 0, 4};
  Model model{3, 1, std::vector<double>(14, 0.0)};
  model.values[3] = 0.9, model.values[4] = 0.5, model.values[5] = -0.2;
  model.values[6] = 0.4, model.values[7] = 0.1;
  const double support = 0.3;
  for (int k = 0; k < 3; ++k) model.values[8 + k] = std::log(std::expm1(support));
  const Render image = render(model, camera, Options{});
  const double bx = std::pow(50 * support / 4, 2) + 0.3, by = std::pow(60 * support / 4, 2) + 0.3;
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x) {
      const double dx = x + 0.5 - 17.5, dy = y + 0.5 - 14.5;
      const double r = dx * dx / bx + dy * dy / by;
      const double alpha = r < 1 ? std::pow(1 - r, 4 * std::exp(0.1)) / (1 + std::exp(-0.4)) : 0;
      const std::size_t i = static_cast<std::size_t>(y) * 40 + x;
      // The largest error observed is 1.7e-16.
      CHECK(image.alpha[i] == Approx(alpha).epsilon(0).margin(3.3e-16));
      CHECK(image.image[2 * 1200 + i] == Approx(-0.2 * alpha).epsilon(0).margin(3.3e-16));
      CHECK(image.contributors[i] == (r < 1));
    }
  CHECK(image.contributors[14 * 40 + 17] == 1);
  CHECK(image.depth[14 * 40 + 17] == Approx(4));
}

// The slope x/z at which the projection is linearised is limited to the image plus a margin of 0.15 times the
// image size on each side. In x, with fx = 50, width 40 and cx = 17.5, the margin is 0.12 and the limits are
// -0.47 and 0.57. In y, with fy = 60, height 30 and cy = 12.5, the margin is 0.075 and the limits are -17/60
// and 22/60.
TEST_CASE("the projection is linearised at most 15 % of the image size outside the image", "[oracle]") {
  Camera camera;
  camera.width = 40, camera.height = 30;
  camera.fx = 50, camera.fy = 60, camera.cx = 17.5, camera.cy = 12.5;
  const auto slopes = [&](double x, double y) {  // returns the values of x/z and y/z that the Jacobian J uses
    const Matrix<double> j = projection_jacobian<double>({2 * x, 2 * y, 2}, camera);
    CHECK((j(0, 0) == 25 && j(1, 1) == 30 && j(0, 1) == 0 && j(1, 0) == 0));
    return std::array<double, 2>{-j(0, 2) / 25, -j(1, 2) / 30};
  };
  const double low_y = -(12.5 / 60 + 0.075), high_y = 17.5 / 60 + 0.075;
  CHECK(slopes(-0.46, low_y + 0.01)[0] == Approx(-0.46).epsilon(1e-14));
  CHECK(slopes(0.56, low_y + 0.01)[1] == Approx(low_y + 0.01).epsilon(1e-14));
  CHECK(slopes(0.56, high_y - 0.01)[0] == Approx(0.56).epsilon(1e-14));
  CHECK(slopes(0, high_y - 0.01)[1] == Approx(high_y - 0.01).epsilon(1e-14));
  CHECK(slopes(-0.9, -0.9)[0] == Approx(-0.47).epsilon(1e-14));
  CHECK(slopes(-0.9, -0.9)[1] == Approx(low_y).epsilon(1e-14));
  CHECK(slopes(0.9, 0.9)[0] == Approx(0.57).epsilon(1e-14));
  CHECK(slopes(0.9, 0.9)[1] == Approx(high_y).epsilon(1e-14));
}

TEST_CASE("splats are culled if they are near, far, indefinite or not finite", "[oracle]") {
  const Scene scene = single_splat_scene({1, 6, 1, 16, 12});
  const Model model = to_model(scene.model);
  Options options = options_of(scene);
  const double z = footprint<double>(raw_of(model, 0), Rows(6), scene.camera, options).depth;
  CHECK(render(model, scene.camera, options).visible == 1);
  options.near_plane = z + 1e-9;
  CHECK(render(model, scene.camera, options).visible == 0);
  options.near_plane = 0.01, options.far_plane = z - 1e-9;
  CHECK(render(model, scene.camera, options).visible == 0);
  options = options_of(scene);
  // The projected covariance B becomes negative definite. Its determinant is positive, so the oracle must
  // check B00 and B11.
  options.eps2d = -1e4;
  CHECK(render(model, scene.camera, options).visible == 0);
  for (int row : {0, 3, 6, 7, 12, 15, 20, 30}) {
    Model broken = model;
    broken.values[row] = std::nan("");
    CHECK(render(broken, scene.camera, options_of(scene)).visible == 0);
  }
}

TEST_CASE("symmetric() mirrors the upper triangle of an asymmetric conditional covariance V", "[oracle]") {
  const Scene scene = regular_scene({40, 7, 11, 32, 24});
  const Model model = to_model(scene.model);
  const Rows rows(7);
  double asymmetry = 0;
  for (std::size_t p = 0; p < model.count; ++p) {
    const Matrix<double> v = condition<double>(raw_of(model, p), rows, scene.camera, Options{}).covariance;
    const Matrix<double> m = symmetric(v);
    asymmetry = std::max(asymmetry, max_difference(v, v.transposed()));
    for (int i = 0; i < 3; ++i)
      for (int j = i; j < 3; ++j) CHECK((m(i, j) == v(i, j) && m(j, i) == v(i, j)));
  }
  CHECK(asymmetry > 1e-4);
}

TEST_CASE("an alpha that is limited to its maximum has no gradient", "[oracle]") {
  Tape tape;
  Footprint<Var> f;
  f.opacity = Var::input(tape, 0.99995), f.beta = Var::input(tape, 0.1);
  const Var inside = Var::input(tape, 0.001);
  const Var clamped = splat_alpha<Var>(f, inside);
  CHECK(clamped.value() == 0.999);
  CHECK(clamped.node() == Tape::kConstant);
  CHECK(splat_alpha<Var>(f, Var::input(tape, 0.5)).node() != Tape::kConstant);
}

TEST_CASE("the derivative at the rim of a splat with a small beta is limited", "[oracle]") {
  for (double rest : {1e-2, 1e-5, 1e-9, 1e-15}) {
    Tape tape;
    const Var r = Var::input(tape, 1 - rest), beta = Var::input(tape, 0.2);
    const Var v = rim_power(r, beta);
    tape.seed(v.node(), 1);
    tape.reverse();
    const double guarded = std::max(1 - r.value(), 1e-5);
    CHECK(v.value() == Approx(std::pow(1 - r.value(), 0.2)).epsilon(1e-12));
    CHECK(tape.adjoint(r.node()) == Approx(-0.2 * v.value() / guarded).epsilon(1e-12));
    CHECK(tape.adjoint(beta.node()) == Approx(v.value() * std::log(1 - r.value())).epsilon(1e-12));
  }
}

TEST_CASE("ssim: values agree with a closed form, gradients with central differences", "[oracle]") {
  const int h = 13, w = 17;
  const std::vector<double> a = smooth_target(w, h, 1), b = smooth_target(w, h, 2);
  CHECK(ssim(a, a, 3, h, w) == Approx(1).epsilon(1e-12));
  const double value = ssim(a, b, 3, h, w);
  CHECK(value < 0.9);
  CHECK(value == Approx(ssim(b, a, 3, h, w)).epsilon(1e-13));

  // For an image of a single pixel, only the weight at the centre of the window matters, which gives a closed
  // form. The weight along one axis is 0.266011715.
  const double centre = 0.266011715 * 0.266011715, p = 0.7, q = 0.4;
  const double mp = centre * p, mq = centre * q;
  const double single =
      (2 * mp * mq + 1e-4) * (2 * (centre * p * q - mp * mq) + 9e-4) /
      ((mp * mp + mq * mq + 1e-4) * (centre * p * p - mp * mp + centre * q * q - mq * mq + 9e-4));
  CHECK(ssim(std::vector<double>{p}, std::vector<double>{q}, 1, 1, 1) ==
        Approx(single).epsilon(4.6e-9));  // the error is 2.3e-9, because the weight has only nine digits

  std::vector<double> moved = a, differences;
  for (std::size_t i = 0; i < a.size(); ++i) {
    moved[i] = a[i] + 1e-5;
    const double up = ssim(moved, b, 3, h, w);
    moved[i] = a[i] - 1e-5;
    differences.push_back((up - ssim(moved, b, 3, h, w)) / 2e-5);
    moved[i] = a[i];
  }
  // The error observed is 2.3e-9.
  CHECK(relative_error(ssim_gradient(a, b, 3, h, w), differences) < 4.6e-9);
}

TEST_CASE("an image that equals the target has no L1 gradient", "[oracle]") {
  const Scene scene = regular_scene({10, 6, 1, 24, 18});
  const Model model = to_model(scene.model);
  Options options = options_of(scene);
  options.loss = loss_weights(0.0f);
  const Gradient g = gradient(model, scene.camera, render(model, scene.camera, options).image, options);
  CHECK(g.loss == 0);
  CHECK(std::all_of(g.values.begin(), g.values.end(), [](double x) { return x == 0; }));
}

TEST_CASE("extreme scenes contain the splats that their names describe, with finite gradients", "[oracle]") {
  for (int dim : {3, 6, 7}) {
    CAPTURE(dim);
    const SceneOptions options{300, dim, 1, 45, 37};
    const auto image_of = [](const Scene& scene) {
      return render(to_model(scene.model), scene.camera, options_of(scene));
    };
    const Render huge = image_of(huge_splat_scene(options));
    CHECK(std::all_of(huge.contributors.begin(), huge.contributors.end(), [](int n) { return n == 1; }));
    CHECK(image_of(behind_camera_scene(options)).visible == 0);
    const Render empty = image_of(empty_scene(options));
    CHECK(empty.image[0] == empty_scene(options).background[0]);
    CHECK(column_sum(empty.alpha) == 0);
    CHECK(column_sum(image_of(single_splat_scene(options)).alpha) > 1);

    const Render crowded = image_of(crowded_tile_scene(options));
    CHECK(crowded.contributors[24 * 45 + 24] > 5);

    const Scene flat_scene = identical_depth_scene(options);
    Model flat = to_model(flat_scene.model);
    const Render in_order = render(flat, flat_scene.camera, options_of(flat_scene));
    for (std::size_t i = 0; i < in_order.depth.size(); ++i)
      CHECK((in_order.alpha[i] < 1e-6 || in_order.depth[i] == Approx(3).epsilon(1e-12)));
    // Splats with equal depths are ordered by index, so the model with reversed splats looks different.
    for (int r = 0; r < Rows(dim).count; ++r)
      std::reverse(flat.values.begin() + static_cast<std::ptrdiff_t>(r * flat.count),
                   flat.values.begin() + static_cast<std::ptrdiff_t>((r + 1) * flat.count));
    CHECK(relative_error(render(flat, flat_scene.camera, options_of(flat_scene)).image, in_order.image) >
          0.01);

    for (const Scene& scene : {huge_splat_scene(options), behind_camera_scene(options), empty_scene(options),
                               crowded_tile_scene(options), flat_scene}) {
      const Gradient g = gradient(to_model(scene.model), scene.camera, scene.target, options_of(scene));
      CHECK(std::all_of(g.values.begin(), g.values.end(), [](double x) { return std::isfinite(x); }));
    }
  }
}

TEST_CASE("a beta kernel with beta 4 differs from a Gaussian by at most 0.0433", "[oracle]") {
  double worst = 0;
  for (int i = 0; i < 30000; ++i) {
    const double x = i * 1e-4;  // distance in standard deviations of the Gaussian; the support ends at 3
    worst = std::max(worst, std::abs(rim_power(x * x / 9, 4.0) - std::exp(-x * x / 2)));
  }
  CHECK(worst == Approx(0.0433).epsilon(0.005));
}

TEST_CASE("permuting the splats does not change the image", "[oracle]") {
  const Scene scene = regular_scene({50, 7, 6, 33, 21});
  const Model model = to_model(scene.model);
  Model reversed = model;
  for (int r = 0; r < Rows(7).count; ++r)
    std::reverse(reversed.values.begin() + static_cast<std::ptrdiff_t>(r * model.count),
                 reversed.values.begin() + static_cast<std::ptrdiff_t>((r + 1) * model.count));
  const Options options = options_of(scene);
  CHECK(render(model, scene.camera, options).image == render(reversed, scene.camera, options).image);
}

}  // namespace ubs::oracle
