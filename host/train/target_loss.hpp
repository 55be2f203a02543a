// SPDX-License-Identifier: Apache-2.0
// The stage ImageLoss for what a renderer has drawn and a ground truth on the device.
#pragma once

#include "host/pipeline/renderer.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/target_images.hpp"

namespace ubs {

// Values alone, of the image as it is.
inline ImageLoss loss_of(const Renderer& renderer, const Target& target, BufferView<float> sums) {
  return {.shape = renderer.shape(),
          .image = renderer.image(),
          .target = target.image,
          .target_float = {},
          .mask = target.mask,
          .counted = target.counted,
          .v_image = {},
          .sums = sums};
}

// And the gradient of the loss that training descends, into the renderer's v_image().
inline ImageLoss training_loss(const Renderer& renderer, const Target& target, const TrainSettings& settings,
                               BufferView<float> sums) {
  ImageLoss loss = loss_of(renderer, target, sums);
  loss.weights = loss_weights(settings);
  loss.scale = 1.0f / static_cast<float>(settings.batch);
  loss.v_image = renderer.v_image();
  return loss;
}

}  // namespace ubs
