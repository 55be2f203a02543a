// SPDX-License-Identifier: Apache-2.0
// Tests the formulas that the oracle uses for variants of the method: spherical harmonics must be
// orthonormal, and rotations must be orthogonal.
#include "host/lab/oracle/variant_formula.hpp"

#include <catch2/catch.hpp>

#include "host/lab/oracle/scenes.hpp"

namespace ubs::oracle {
namespace {

Matrix<double> skew3(double a, double b, double c) {
  Matrix<double> m(3, 3);
  m(0, 1) = a, m(0, 2) = b, m(1, 2) = c;
  m(1, 0) = -a, m(2, 0) = -b, m(2, 1) = -c;
  return m;
}

double distance(const Matrix<double>& a, const Matrix<double>& b) {
  double worst = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) worst = std::max(worst, std::abs(a(i, j) - b(i, j)));
  return worst;
}

TEST_CASE("spherical harmonics are orthonormal on the sphere", "[oracle][variants]") {
  // Integrates the products with the midpoint rule in the angle and 8 Gauss-Legendre nodes in z. This is
  // exact, because products of two harmonics have a degree of at most 6.
  const double nodes[4] = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363};
  const double weights[4] = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745, 0.1012285362903763};
  constexpr int kAngles = 16;
  double gram[16][16] = {};
  for (int n = 0; n < 8; ++n)
    for (int k = 0; k < kAngles; ++k) {
      const double z = n < 4 ? nodes[n] : -nodes[n - 4], s = std::sqrt(1 - z * z);
      const double angle = 2 * std::numbers::pi * (k + 0.5) / kAngles;
      const auto y = spherical_harmonics<double>({s * std::cos(angle), s * std::sin(angle), z}, 16);
      for (std::size_t i = 0; i < 16; ++i)
        for (std::size_t j = 0; j < 16; ++j)
          gram[i][j] += y[i] * y[j] * weights[n % 4] * 2 * std::numbers::pi / kAngles;
    }
  for (int i = 0; i < 16; ++i)
    for (int j = 0; j < 16; ++j) CHECK(gram[i][j] == Approx(i == j ? 1 : 0).margin(1e-12));
}

TEST_CASE("Cayley, exponential and quaternion rotations are orthogonal and agree", "[oracle][variants]") {
  Random random(3);
  const Matrix<double> one = Matrix<double>::identity(3);
  for (int i = 0; i < 50; ++i) {
    const Matrix<double> a = skew3(random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(-2, 2));
    for (const RotMode mode : {RotMode::cayley, RotMode::exp}) {
      const Matrix<double> r = skew_rotation(a, mode);
      CHECK(distance(r * r.transposed(), one) < 1e-12);
    }
    // exp(A) rotates by |omega| about omega = (-a2, a1, -a0).
    const double omega[3] = {-a(1, 2), a(0, 2), -a(0, 1)};
    const double angle = std::hypot(omega[0], omega[1], omega[2]);
    const double s = std::sin(angle / 2) / angle;
    const Matrix<double> q =
        quaternion_rotation<double>({std::cos(angle / 2), s * omega[0], s * omega[1], s * omega[2]});
    CHECK(distance(skew_rotation(a, RotMode::exp), q) < 1e-12);
    // For small angles, all modes agree up to the order of their errors.
    const Matrix<double> small = scaled(a, 1e-3);
    CHECK(distance(skew_rotation(small, RotMode::taylor1), skew_rotation(small, RotMode::exp)) < 1e-4);
    CHECK(distance(skew_rotation(small, RotMode::taylor2), skew_rotation(small, RotMode::exp)) < 1e-7);
    CHECK(distance(skew_rotation(scaled(small, 0.5), RotMode::cayley), skew_rotation(small, RotMode::exp)) <
          1e-7);
  }
}

}  // namespace
}  // namespace ubs::oracle
