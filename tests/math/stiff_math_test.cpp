// SPDX-License-Identifier: Apache-2.0
// Tests formulas of kernels/math for stiff splats. These are splats with very different scales, for which the
// usual formulas lose digits by cancellation. The expected results are known exactly or computed in another
// way.
#include <catch2/catch.hpp>
#include <random>

#include "tests/math/shared_math.hpp"

namespace {

double uniform(std::mt19937_64& g, double low, double high) {
  return low + (high - low) * static_cast<double>(g() >> 11) * 0x1p-53;
}

FrameMat identity() {
  FrameMat k{};
  for (int i = 0; i < 3; ++i) k.e[i][i] = 1;
  return k;
}

TEST_CASE("if K is not symmetric, the ellipse is computed from the upper triangle of M K M^T", "[math]") {
  std::mt19937_64 g(3);
  double worst = 0;
  for (int round = 0; round < 200; ++round) {
    ImageMap t;
    FrameMap m;
    FrameMat k = identity();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        m.e[i][j] = uniform(g, -1, 1);
        k.e[i][j] += uniform(g, -0.2, 0.2);
        if (i < 2) t.e[i][j] = uniform(g, -1, 1);
      }
    double v[3][3] = {}, b[2][2] = {{0.3, 0}, {0, 0.3}};
    for (int r = 0; r < 3; ++r)
      for (int c = r; c < 3; ++c) {
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j) v[r][c] += m.e[r][i] * k.e[i][j] * m.e[c][j];
        v[c][r] = v[r][c];
      }
    for (int r = 0; r < 2; ++r)
      for (int c = 0; c < 2; ++c)
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j) b[r][c] += t.e[r][i] * v[i][j] * t.e[c][j];
    const Ellipse e = ellipse_on_image(t, m, k, 0.3);
    const double det = b[0][0] * b[1][1] - b[0][1] * b[0][1];
    for (const double error : {e.cov.a - b[0][0], e.cov.b - b[0][1], e.cov.c - b[1][1], e.det - det})
      worst = std::max(worst, std::abs(error));
  }
  CHECK(worst < 5.4e-15);  // the largest error observed is 2.7e-15, from rounding
}

// The ellipse has the axes s0 and s1 and is rotated by 0.6 rad about the line of sight. Its determinant is
// s0^2 s1^2 + eps (s0^2 + s1^2) + eps^2.
TEST_CASE("the determinant of a very long ellipse is computed without cancellation", "[math]") {
  const ImageMap t{{{1, 0, 0}, {0, 1, 0}}};
  const double s = std::sin(0.6), c = std::cos(0.6);
  for (const double ratio : {1.0, 1e3, 1e6, 1e9, 1e12}) {
    const double s0 = 0.1 * ratio, s1 = 0.1;
    const FrameMap m{{{c * s0, -s * s1, 0}, {s * s0, c * s1, 0}, {0, 0, s1}}};
    const double exact = s0 * s0 * s1 * s1 + 0.3 * (s0 * s0 + s1 * s1) + 0.09;
    const Ellipse e = ellipse_on_image(t, m, identity(), 0.3);
    CHECK(e.det == Approx(exact).epsilon(1e-15));
    if (ratio > 1e8)
      // The usual formula a c - b^2 for the determinant is wrong by more than 10 %.
      CHECK(std::abs(e.cov.a * e.cov.c - e.cov.b * e.cov.b - exact) > 0.1 * exact);
    const ConicFactor l = conic_factor(e.cov, e.det);
    CHECK(l.l00 * l.l00 * l.l11 * l.l11 == Approx(1 / exact).epsilon(1e-14));
  }
}

TEST_CASE("the gradient with respect to the axis lengths of a very long ellipse is exact", "[math]") {
  const ImageMap t{{{1, 0, 0}, {0, 1, 0}}};
  const double s = std::sin(0.6), c = std::cos(0.6);
  for (const double ratio : {1.0, 1e4, 1e8}) {
    const double s0 = 10 * ratio, s1 = 10;
    const FrameMap m{{{c * s0, -s * s1, 0}, {s * s0, c * s1, 0}, {0, 0, 1e-3}}};
    const Ellipse e = ellipse_on_image(t, m, identity(), 0.3);
    // With the gradient W = I, the loss is ln det B, because tr(L dB L^T) = d ln det B. The derivative of ln
    // det B with respect to ln s0 is 2 s0^2 / (s0^2 + eps).
    const EllipseInputVjp v = ellipse_vjp(t, m, identity(), e, {1, 0, 1}, 0.3, 0);
    CHECK(v.along.e[0] == Approx(2 * s0 * s0 / (s0 * s0 + 0.3)).epsilon(1e-12));
    CHECK(v.along.e[1] == Approx(2 * s1 * s1 / (s1 * s1 + 0.3)).epsilon(1e-12));
  }
}

// The splat has radii of 20 px, and K = diag(1, -k, 1). Then det(T V T^T) = -160000 k, and the blur adds
// 0.3 (400 - 400 k + 0.3) to the determinant. The limit is UBS_DEFINITE (kernels/limits.h).
TEST_CASE("an ellipse is rendered only if its determinant exceeds a tenth of what the blur adds to it",
          "[math]") {
  CameraView cam{};
  for (int i = 0; i < 3; ++i) cam.rotation[i][i] = 1;
  cam.fx = cam.fy = 100, cam.cx = cam.cy = 32, cam.width = cam.height = 64;
  cam.near_plane = 0.01, cam.far_plane = 100, cam.eps2d = 0.3;
  const FrameMap m{{{0.2, 0, 0}, {0, 0.2, 0}, {0, 0, 0.2}}};
  for (const double left : {-0.1, 0.01, 0.09, 0.11, 0.5, 1.0}) {  // determinant / amount that the blur adds
    FrameMat k = identity();
    k.e[1][1] = -(1 - left) * 0.3 * 400.3 / (160000 + (1 - left) * 0.3 * 400);
    const Projected p = project(cam, {{0, 0, 1}}, m, k);
    CHECK(p.ellipse.det == Approx(left * 0.3 * (400 + 400 * k.e[1][1] + 0.3)).epsilon(1e-9));
    CHECK((p.valid != 0) == (left > 0.1));
  }
}

TEST_CASE("ln(1 - tanh u) keeps its relative accuracy for small u", "[math]") {
  double worst = 0;
  for (double u = 1e-12; u < 8; u *= 1.07) {
    const long double x = u, exact = -x - std::log(std::cosh(x));
    const double got = log_one_minus_tanh(Several{{u}}, 1).e[0];
    worst = std::max(worst, static_cast<double>(std::abs((got - exact) / exact)));
  }
  CHECK(worst < 3.2e-10);  // the largest error observed is 1.6e-10, where the series ends at u = 1/4
}

TEST_CASE("query rows that are nearly linearly dependent become orthogonal", "[math]") {
  std::mt19937_64 g(9);
  double worst = 0;
  for (int round = 0; round < 50; ++round) {
    SliceInput in{};
    for (int i = 0; i < UBS_C; ++i) {
      for (int k = 0; k < 3; ++k) in.b[i][k] = uniform(g, -1, 1);
      in.b[i][3 + i] = 1e-6;
    }
    const Slice s = slice_factor(in);
    for (int i = 0; i < UBS_C; ++i)
      for (int j = 0; j < i; ++j) {
        double dot = 0;
        for (int k = 0; k < 3 + UBS_C; ++k) dot += s.q[i][k] * s.q[j][k];
        worst = std::max(worst, std::abs(dot));
      }
  }
  // The largest value observed is 1.6e-16. With only one pass of orthogonalisation it is 1e-10.
  CHECK(worst < 3.2e-16);
}

}  // namespace
