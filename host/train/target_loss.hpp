// SPDX-License-Identifier: Apache-2.0
// loss_of() and training_loss() create the operation ImageLoss for the image of a renderer and a ground truth
// on the device. loss_weights() and penalty_weights() compute the weights of the loss and of the penalties of
// parameters from the settings.
#pragma once

#include "host/device/loss_weights.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/target_images.hpp"

namespace ubs {

inline LossWeights loss_weights(const TrainSettings& settings) {
  return loss_weights(static_cast<float>(settings.lambda_dssim));
}
inline PenaltyWeights penalty_weights(const TrainSettings& settings) {
  PenaltyWeights w;
  auto& [opacity, scale] = w;  // all terms: this does not compile when one is added
  opacity = static_cast<float>(settings.opacity_reg);
  scale = static_cast<float>(settings.scale_penalty);
  return w;
}

// Returns the operation that computes the values of the loss, but no gradient. No appearance map is applied
// to the image.
inline ImageLoss loss_of(const ImageShape& shape, BufferView<float> image, const Target& target,
                         BufferView<float> sums) {
  return {.shape = shape,
          .image = image,
          .target = target.image,
          .target_float = {},
          .mask = target.mask,
          .counted = target.counted,
          .v_image = {},
          .sums = sums};
}
inline ImageLoss loss_of(const Renderer& renderer, const Target& target, BufferView<float> sums) {
  return loss_of(renderer.shape(), renderer.image(), target, sums);
}

// Returns the operation that computes the values of the training loss and stores its gradient in the
// renderer's v_image().
inline ImageLoss training_loss(const Renderer& renderer, const Target& target, const TrainSettings& settings,
                               BufferView<float> sums) {
  ImageLoss loss = loss_of(renderer, target, sums);
  loss.weights = loss_weights(settings);
  loss.scale = 1.0f / static_cast<float>(settings.batch);
  loss.v_image = renderer.v_image();
  return loss;
}

}  // namespace ubs
