// SPDX-License-Identifier: Apache-2.0
// The weights of the loss from the settings, what kernels multiply with, and the value of the loss.
#pragma once

#include <span>

#include "host/scene/train_settings.hpp"
#include "kernels/loss_weights.h"

namespace ubs {

inline LossWeights loss_weights(float lambda_dssim) { return {1 - lambda_dssim, lambda_dssim}; }
inline LossWeights loss_weights(const TrainSettings& settings) {
  return loss_weights(static_cast<float>(settings.lambda_dssim));
}
// Weights of one of the values that the terms are means over. scale: that of the gradient.
inline LossWeights per_value(LossWeights w, float scale, float values) {
  return {w.l1 * scale / values, w.dssim * scale / values};
}
// The loss of an image, without penalties. sums: the eight numbers of the stage ImageLoss.
inline double loss_value(LossWeights w, std::span<const float> sums) {
  return static_cast<double>(w.l1) * sums[0] +
         static_cast<double>(w.dssim) * (1 - static_cast<double>(sums[1]));
}

inline PenaltyWeights penalty_weights(const TrainSettings& settings) {
  return {static_cast<float>(settings.opacity_reg), static_cast<float>(settings.scale_penalty)};
}
inline bool any(PenaltyWeights w) { return w.opacity != 0 || w.scale != 0; }
// Weights of the values of one splat. Penalties are means over splats and, of scales, over their three axes.
inline PenaltyWeights per_splat(PenaltyWeights w, float splats) {
  return {w.opacity / splats, w.scale / (3 * splats)};
}

}  // namespace ubs
