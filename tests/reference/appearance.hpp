// SPDX-License-Identifier: Apache-2.0
// Implements the correction of exposure and white balance (the setting `appearance`) in double precision: a
// colour x becomes y = (diag(exp d) + M) x + b, where the diagonal of M is 0. The derivatives are computed by
// automatic differentiation with a tape.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "host/lab/oracle/tape.hpp"

namespace ubs::oracle {

template <typename S>
struct ColourBalance {
  std::array<S, 3> log_gain, offset;
  std::array<std::array<S, 3>, 3> mixing;  // its diagonal is not used
};

template <typename S>
std::array<S, 3> balanced(const ColourBalance<S>& balance, const std::array<S, 3>& colour) {
  using std::exp;
  std::array<S, 3> out;
  for (std::size_t to = 0; to < 3; ++to) {
    S sum = balance.offset[to] + exp(balance.log_gain[to]) * colour[to];
    for (std::size_t from = 0; from < 3; ++from)
      if (from != to) sum = sum + balance.mixing[to][from] * colour[from];
    out[to] = sum;
  }
  return out;
}

// Converts the 12 numbers of a view: for each of the three output channels, three factors and an offset. The
// factor from a channel to itself is stored as its logarithm.
template <typename S>
ColourBalance<S> balance_of(std::span<const S, 12> rows) {
  ColourBalance<S> b;
  for (std::size_t to = 0; to < 3; ++to) {
    b.log_gain[to] = rows[4 * to + to];
    b.offset[to] = rows[4 * to + 3];
    for (std::size_t from = 0; from < 3; ++from) b.mixing[to][from] = rows[4 * to + from];
  }
  return b;
}

// Returns the image after the correction. Both images have the shape (3, pixels).
inline std::vector<double> balanced_image(std::span<const double, 12> rows, std::span<const double> image) {
  const std::size_t pixels = image.size() / 3;
  std::vector<double> out(image.size());
  const ColourBalance<double> balance = balance_of<double>(rows);
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto colour = balanced<double>(balance, {image[i], image[pixels + i], image[2 * pixels + i]});
    for (std::size_t c = 0; c < 3; ++c) out[c * pixels + i] = colour[c];
  }
  return out;
}

struct BalanceGradient {
  std::array<double, 12> rows{};
  std::vector<double> image;
};

// Returns the gradients of a loss with respect to `rows` and `image`. v_balanced is the gradient with respect
// to the corrected image.
inline BalanceGradient balance_gradient(std::span<const double, 12> rows, std::span<const double> image,
                                        std::span<const double> v_balanced) {
  const std::size_t pixels = image.size() / 3;
  BalanceGradient out;
  out.image.resize(image.size());
  Tape tape;
  for (std::size_t i = 0; i < pixels; ++i) {
    tape.clear();
    std::array<Var, 12> inputs;
    for (std::size_t q = 0; q < 12; ++q) inputs[q] = Var::input(tape, rows[q]);
    std::array<Var, 3> colour;
    for (std::size_t c = 0; c < 3; ++c) colour[c] = Var::input(tape, image[c * pixels + i]);
    const auto result = balanced<Var>(balance_of<Var>(std::span<const Var, 12>(inputs)), colour);
    for (std::size_t c = 0; c < 3; ++c) tape.seed(result[c].node(), v_balanced[c * pixels + i]);
    tape.reverse();
    for (std::size_t q = 0; q < 12; ++q) out.rows[q] += tape.adjoint(inputs[q].node());
    for (std::size_t c = 0; c < 3; ++c) out.image[c * pixels + i] = tape.adjoint(colour[c].node());
  }
  return out;
}

}  // namespace ubs::oracle
