// SPDX-License-Identifier: Apache-2.0
// Loss of one view and its gradient with respect to every raw parameter, without regularisers: the door
// through which other implementations and the test oracle check this one.
#pragma once

#include <span>

#include "host/pipeline/renderer.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

struct ViewLoss {
  double loss = 0;  // (1 - lambda) l1 + lambda (1 - ssim)
  double l1 = 0, ssim = 0;
};
struct ViewGradient : ViewLoss {
  SplatModel values;  // gradient in place of each parameter
};
struct MixedViewGradient : ViewLoss {
  MixedModel values;
  CameraGradient camera;
};

// With what is there already: the renderer, whose camera it sets, and room for the gradients (empty: the loss
// alone).
ViewLoss view_loss(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                   std::span<const BufferView<float>> v_params, const Camera& camera,
                   std::span<const float> target, const RenderSettings& settings, float lambda_dssim,
                   std::span<const std::uint8_t> mask);

// target: (3, height, width) planar, any real values; mask: (height, width), 0 = does not count, or empty.
// The stages must have backward and nothing frozen.
ViewGradient view_gradient(Device& device, Stages& stages, const SplatModel& model, const Camera& camera,
                           std::span<const float> target, const RenderSettings& settings, float lambda_dssim,
                           std::span<const std::uint8_t> mask = {});
// The same for groups, and with `camera_too` the gradient of the camera; of `config` they replace N and the
// form.
MixedViewGradient view_gradient(Device& device, const KernelConfig& config, const MixedModel& model,
                                const Camera& camera, std::span<const float> target,
                                const RenderSettings& settings, float lambda_dssim,
                                std::span<const std::uint8_t> mask = {}, bool camera_too = false);

}  // namespace ubs
