// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/view_gradient.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/pipeline/device_groups.hpp"

namespace ubs {

ViewLoss view_loss(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                   std::span<const BufferView<float>> v_params, const Camera& camera,
                   std::span<const float> target, const RenderSettings& settings, float lambda_dssim,
                   std::span<const std::uint8_t> mask) {
  const std::size_t expected =
      3 * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  if (target.size() != expected)
    fail(ErrorKind::data, "the target has {} values, but the view {}x{} needs {}", target.size(),
         camera.width, camera.height, expected);
  if (stages.config().frozen != 0)
    fail(ErrorKind::internal,
         "the gradient of a view requires the gradients of all parameters, but some of them are frozen");
  renderer.set_cameras({camera});
  Buffer<float> target_buffer(device, "target image", target.size());
  target_buffer.upload(target);
  if (!mask.empty() && mask.size() != expected / 3)
    fail(ErrorKind::data, "the mask has {} values, but the view {}x{} needs {}", mask.size(), camera.width,
         camera.height, expected / 3);
  Buffer<std::uint8_t> mask_buffer;
  if (!mask.empty()) {
    mask_buffer = Buffer<std::uint8_t>(device, "target mask", mask.size());
    mask_buffer.upload(mask);
  }
  const auto masked_out = std::ranges::count(mask, std::uint8_t{0});
  Buffer<float> sums(device, "loss sums", 8);
  const bool learns = !v_params.empty();
  renderer.forward(groups, 0, settings, learns);
  stages.image_loss(
      {.shape = renderer.shape(),
       .image = renderer.image(),
       .target = {},
       .target_float = target_buffer.view(),
       .mask = mask_buffer.view(),
       .counted = static_cast<std::uint32_t>(mask.size() - static_cast<std::size_t>(masked_out)),
       .weights = loss_weights(lambda_dssim),
       .v_image = learns ? renderer.v_image() : BufferView<float>{},
       .sums = sums.view()});
  if (learns) renderer.backward(v_params, false);
  const std::vector<float> values = sums.download();
  ViewLoss out;
  out.l1 = values[0];
  out.ssim = values[1];
  out.loss = loss_value(loss_weights(lambda_dssim), values);
  return out;
}

ViewGradient view_gradient(Device& device, Stages& stages, const SplatModel& model, const Camera& camera,
                           std::span<const float> target, const RenderSettings& settings, float lambda_dssim,
                           std::span<const std::uint8_t> mask) {
  const DeviceModel on_device(device, model);
  Renderer renderer(device, stages);
  const Buffer<float> v_params(device, "parameter gradients",
                               static_cast<std::size_t>(on_device.rows()) * on_device.stride());
  const RenderGroup group{&stages, on_device.view()};
  const BufferView<float> v_view = v_params.view();
  ViewGradient out{view_loss(device, stages, renderer, std::span(&group, 1), std::span(&v_view, 1), camera,
                             target, settings, lambda_dssim, mask),
                   {}};
  out.values = download_rows(v_params, on_device.layout(), on_device.count(), on_device.stride());
  return out;
}

MixedViewGradient view_gradient(Device& device, const KernelConfig& config, const MixedModel& model,
                                const Camera& camera, std::span<const float> target,
                                const RenderSettings& settings, float lambda_dssim,
                                std::span<const std::uint8_t> mask, bool camera_too) {
  const DeviceGroups on_device(device, model, config);
  Renderer renderer(device, on_device.stages());
  const GroupBuffers v_params(device, on_device, "parameter gradients");
  MixedViewGradient out{view_loss(device, on_device.stages(), renderer, on_device.view(), v_params.view(),
                                  camera, target, settings, lambda_dssim, mask),
                        MixedModel(std::vector<SplatModel>{}),
                        {}};
  if (camera_too) out.camera = renderer.camera_gradient();
  for (std::size_t g = 0; g < model.groups.size(); ++g) {
    const DeviceModel& group = on_device.groups()[g];
    out.values.groups.push_back(download_rows(v_params[g], group.layout(), group.count(), group.stride()));
  }
  return out;
}

}  // namespace ubs
