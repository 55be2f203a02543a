// SPDX-License-Identifier: Apache-2.0
// view_gradient() computes the loss of one view and its gradient with respect to every raw parameter, without
// regularisers. It is used to compare this implementation with other implementations and with the float64
// reference of the tests.
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
  SplatModel values;  // contains, in place of each parameter, the derivative of the loss with respect to it
};
// MixedViewGradient contains the gradient of a model with several groups, and the gradient of the camera if
// it was requested.
struct MixedViewGradient : ViewLoss {
  MixedModel values;
  CameraGradient camera;
};

// Computes the loss and the gradients with an existing renderer, and writes the gradients to the existing
// buffers v_params. The cameras of the renderer are replaced by `camera`. If v_params is empty, the function
// only computes the loss.
ViewLoss view_loss(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                   std::span<const BufferView<float>> v_params, const Camera& camera,
                   std::span<const float> target, const RenderSettings& settings, float lambda_dssim,
                   std::span<const std::uint8_t> mask);

// Computes the loss and the gradient for a model of one group. `target` is planar, (3, height, width), with
// any real values. `mask` has the shape (height, width); a pixel with the value 0 does not count. If the mask
// is empty, all pixels count. The stages must be configured with `backward` and without frozen parameters.
ViewGradient view_gradient(Device& device, Stages& stages, const SplatModel& model, const Camera& camera,
                           std::span<const float> target, const RenderSettings& settings, float lambda_dssim,
                           std::span<const std::uint8_t> mask = {});
// This overload does the same for a model of several groups. With `camera_too` it also computes the gradient
// of the loss with respect to the camera. N and variant of `config` are replaced by those of the groups.
MixedViewGradient view_gradient(Device& device, const KernelConfig& config, const MixedModel& model,
                                const Camera& camera, std::span<const float> target,
                                const RenderSettings& settings, float lambda_dssim,
                                std::span<const std::uint8_t> mask = {}, bool camera_too = false);

}  // namespace ubs
