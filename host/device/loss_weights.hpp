// SPDX-License-Identifier: Apache-2.0
// These functions compute with the weights of the loss and of the penalties (docs/method.md, section 4.1).
// Each one names all weights of its struct in a structured binding. So it does not compile when a term is
// added, until it says what the term means here. host/train/target_loss.hpp computes the weights from the
// settings.
#pragma once

#include <span>

#include "kernels/loss_weights.h"

namespace ubs {

inline LossWeights loss_weights(float lambda_dssim) {
  LossWeights w;
  auto& [l1, dssim] = w;
  l1 = 1 - lambda_dssim;
  dssim = lambda_dssim;
  return w;
}
// Returns the weights with which a single value of the image contributes to the gradient. `w` contains the
// weights of the means over `values` values, and `scale` is a factor for the whole gradient.
inline LossWeights per_value(LossWeights w, float scale, float values) {
  auto& [l1, dssim] = w;
  l1 = l1 * scale / values;
  dssim = dssim * scale / values;
  return w;
}
// Returns the loss of an image without penalties. `sums` contains the eight numbers that the stage ImageLoss
// computes.
inline double loss_value(LossWeights w, std::span<const float> sums) {
  const auto [l1, dssim] = w;
  return static_cast<double>(l1) * sums[0] + static_cast<double>(dssim) * (1 - static_cast<double>(sums[1]));
}

inline bool any(PenaltyWeights w) {
  const auto [opacity, scale] = w;
  return opacity != 0 || scale != 0;
}
// Returns the weights with which a single splat contributes to the penalties. `w` contains the weights of the
// means over all splats. The penalty of the scales is a mean over all splats and their three axes.
inline PenaltyWeights per_splat(PenaltyWeights w, float splats) {
  auto& [opacity, scale] = w;
  opacity /= splats;
  scale /= 3 * splats;
  return w;
}

}  // namespace ubs
