// SPDX-License-Identifier: Apache-2.0
#include "host/train/fit_appearance.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "host/base/error.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {
namespace {

constexpr double kAppearanceRidge = 1e-6, kMinGain = 1e-3;

using Vector4 = std::array<double, 4>;
using Matrix4 = std::array<Vector4, 4>;

// Solves m x = right for a positive definite matrix m by Gaussian elimination.
Vector4 solve_definite(Matrix4 m, Vector4 right) {
  for (std::size_t k = 0; k < 4; ++k)
    for (std::size_t i = k + 1; i < 4; ++i) {
      const double factor = m[i][k] / m[k][k];
      for (std::size_t j = k; j < 4; ++j) m[i][j] -= factor * m[k][j];
      right[i] -= factor * right[k];
    }
  for (std::size_t k = 4; k-- > 0;) {
    for (std::size_t j = k + 1; j < 4; ++j) right[k] -= m[k][j] * right[j];
    right[k] /= m[k][k];
  }
  return right;
}

}  // namespace

std::vector<float> fit_appearance(const RenderedView& render, const PhotographPixels& photograph,
                                  Appearance fit) {
  const std::size_t pixels = render.rgb.size() / 3;
  Matrix4 gram{};
  std::array<Vector4, 3> cross{};
  double counted = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    if (!photograph.mask.empty() && photograph.mask[i] == 0) continue;
    const float* rgb = &render.rgb[3 * i];
    const Vector4 x{rgb[0], rgb[1], rgb[2], 1};
    for (std::size_t a = 0; a < 4; ++a)
      for (std::size_t b = 0; b < 4; ++b) gram[a][b] += x[a] * x[b];
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t a = 0; a < 4; ++a) cross[c][a] += photograph.planes[c * pixels + i] / 255.0 * x[a];
    ++counted;
  }
  const double ridge = kAppearanceRidge * std::max(1.0, counted);
  std::vector<float> numbers(kAppearanceNumbers);
  for (std::size_t c = 0; c < 3; ++c) {
    Vector4 row{};
    if (fit == Appearance::gain) {
      row[c] = (cross[c][c] + ridge) / (gram[c][c] + ridge);
    } else {
      Matrix4 m = gram;
      Vector4 right = cross[c];
      for (std::size_t k = 0; k < 4; ++k) m[k][k] += ridge;
      right[c] += ridge;
      row = solve_definite(m, right);
    }
    row[c] = std::log(std::max(kMinGain, row[c]));
    for (std::size_t k = 0; k < 4; ++k) numbers[4 * c + k] = static_cast<float>(row[k]);
  }
  return numbers;
}

}  // namespace ubs
