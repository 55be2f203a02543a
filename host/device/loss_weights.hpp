// SPDX-License-Identifier: Apache-2.0
// These functions compute the weights of the loss and of the penalties from the settings, and the value of
// the loss (docs/method.md, section 4.1).
#pragma once

#include <span>

#include "host/settings/train_settings.hpp"
#include "kernels/loss_weights.h"

namespace ubs {

inline LossWeights loss_weights(float lambda_dssim) { return {1 - lambda_dssim, lambda_dssim}; }
inline LossWeights loss_weights(const TrainSettings& settings) {
  return loss_weights(static_cast<float>(settings.lambda_dssim));
}
// Returns the weights with which a single value of the image contributes to the gradient. `w` contains the
// weights of the means over `values` values, and `scale` is a factor for the whole gradient.
inline LossWeights per_value(LossWeights w, float scale, float values) {
  return {w.l1 * scale / values, w.dssim * scale / values};
}
// Returns the loss of an image without penalties. `sums` contains the eight numbers that the stage ImageLoss
// computes.
inline double loss_value(LossWeights w, std::span<const float> sums) {
  return static_cast<double>(w.l1) * sums[0] +
         static_cast<double>(w.dssim) * (1 - static_cast<double>(sums[1]));
}

inline PenaltyWeights penalty_weights(const TrainSettings& settings) {
  return {static_cast<float>(settings.opacity_reg), static_cast<float>(settings.scale_penalty)};
}
inline bool any(PenaltyWeights w) { return w.opacity != 0 || w.scale != 0; }
// Returns the weights with which a single splat contributes to the penalties. `w` contains the weights of the
// means over all splats. The penalty of the scales is a mean over all splats and their three axes.
inline PenaltyWeights per_splat(PenaltyWeights w, float splats) {
  return {w.opacity / splats, w.scale / (3 * splats)};
}

}  // namespace ubs
