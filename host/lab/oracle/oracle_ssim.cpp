// SPDX-License-Identifier: Apache-2.0
// This file implements the SSIM of the oracle, with sums over dense 11 x 11 windows and zero padding. The
// tape differentiates each value of the SSIM map with respect to the sums of its window. The transposed
// window sums (scatter) then give the derivatives with respect to the pixels. No closed-form SSIM gradient is
// used.
#include <array>
#include <cmath>
#include <stdexcept>

#include "host/lab/oracle/oracle.hpp"
#include "host/lab/oracle/tape.hpp"

namespace ubs::oracle {
namespace {

constexpr int kRadius = 5;
constexpr double kC1 = 1e-4, kC2 = 9e-4;

std::array<double, 2 * kRadius + 1> window_weights() {
  std::array<double, 2 * kRadius + 1> weights{};
  double sum = 0;
  for (int k = -kRadius; k <= kRadius; ++k) sum += weights[k + kRadius] = std::exp(-k * k / (2 * 1.5 * 1.5));
  for (double& w : weights) w /= sum;
  return weights;
}

// Calls visit(neighbour index, weight) for the part of the window of (row, column) that is in the image.
template <class Visit>
void for_window(int row, int column, int height, int width, const Visit& visit) {
  static const std::array<double, 2 * kRadius + 1> kWeights = window_weights();
  for (int i = -kRadius; i <= kRadius; ++i) {
    if (row + i < 0 || row + i >= height) continue;
    for (int j = -kRadius; j <= kRadius; ++j) {
      if (column + j < 0 || column + j >= width) continue;
      visit((row + i) * width + column + j, kWeights[i + kRadius] * kWeights[j + kRadius]);
    }
  }
}

struct Moments {
  double a = 0, b = 0, aa = 0, bb = 0, ab = 0;  // window sums of a, b, a*a, b*b, a*b
};

Moments window_moments(const double* a, const double* b, int row, int column, int height, int width) {
  Moments m;
  for_window(row, column, height, width, [&](int i, double w) {
    m.a += w * a[i], m.b += w * b[i];
    m.aa += w * a[i] * a[i], m.bb += w * b[i] * b[i], m.ab += w * a[i] * b[i];
  });
  return m;
}

template <class S>
S similarity(const S& a, double b, const S& aa, double bb, const S& ab) {
  const S variance_a = aa - a * a, covariance = ab - a * b;
  const double variance_b = bb - b * b;
  return (2.0 * a * b + kC1) * (2.0 * covariance + kC2) /
         ((a * a + b * b + kC1) * (variance_a + variance_b + kC2));
}

void check_sizes(std::size_t a, std::size_t b, int channels, int height, int width) {
  const std::size_t expected = static_cast<std::size_t>(channels) * height * width;
  if (a != expected || b != expected) throw std::invalid_argument("oracle: wrong image size");
}

// Adds `scale` times the derivative of the sum of the SSIM map of one channel with respect to `a` to `out`.
void add_channel_gradient(const double* a, const double* b, int height, int width, double scale,
                          double* out) {
  Tape tape;
  for (int row = 0; row < height; ++row)
    for (int column = 0; column < width; ++column) {
      const Moments m = window_moments(a, b, row, column, height, width);
      tape.clear();
      const Var mean = Var::input(tape, m.a), square = Var::input(tape, m.aa), cross = Var::input(tape, m.ab);
      tape.seed(similarity<Var>(mean, m.b, square, m.bb, cross).node(), scale);
      tape.reverse();
      const double ga = tape.adjoint(mean.node()), gaa = tape.adjoint(square.node());
      const double gab = tape.adjoint(cross.node());
      for_window(row, column, height, width,
                 [&](int i, double w) { out[i] += w * (ga + 2 * a[i] * gaa + b[i] * gab); });
    }
}

}  // namespace

namespace {

// Returns the mean SSIM of the windows whose centres are at least `margin` pixels inside the image.
double mean_similarity(std::span<const double> a, std::span<const double> b, int channels, int height,
                       int width, int margin) {
  check_sizes(a.size(), b.size(), channels, height, width);
  const std::size_t pixels = static_cast<std::size_t>(height) * width;
  double sum = 0, windows = 0;
  for (int c = 0; c < channels; ++c)
    for (int row = margin; row < height - margin; ++row)
      for (int column = margin; column < width - margin; ++column) {
        const Moments m =
            window_moments(a.data() + c * pixels, b.data() + c * pixels, row, column, height, width);
        sum += similarity<double>(m.a, m.b, m.aa, m.bb, m.ab);
        ++windows;
      }
  return sum / windows;
}

}  // namespace

double ssim(std::span<const double> a, std::span<const double> b, int channels, int height, int width) {
  return mean_similarity(a, b, channels, height, width, 0);
}

double valid_ssim(std::span<const double> a, std::span<const double> b, int channels, int height, int width) {
  return mean_similarity(a, b, channels, height, width, kRadius);
}

std::vector<double> ssim_gradient(std::span<const double> a, std::span<const double> b, int channels,
                                  int height, int width) {
  check_sizes(a.size(), b.size(), channels, height, width);
  std::vector<double> result(a.size(), 0.0);
  const std::size_t pixels = static_cast<std::size_t>(height) * width;
  for (int c = 0; c < channels; ++c)
    add_channel_gradient(a.data() + c * pixels, b.data() + c * pixels, height, width,
                         1 / static_cast<double>(a.size()), result.data() + c * pixels);
  return result;
}

}  // namespace ubs::oracle
