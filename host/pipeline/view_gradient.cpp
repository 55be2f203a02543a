// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/view_gradient.hpp"

#include "host/base/error.hpp"
#include "host/pipeline/device_model.hpp"

namespace ubs {

ViewGradient view_gradient(Device& device, Stages& stages, const SplatModel& model, const Camera& camera,
                           std::span<const float> target, const RenderSettings& settings, float lambda_dssim) {
  const std::size_t expected = 3 * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  if (target.size() != expected)
    fail(ErrorKind::data, "the target has {} values, the view {}x{} needs {}", target.size(), camera.width,
         camera.height, expected);
  if (stages.config().frozen != 0)
    fail(ErrorKind::internal, "the gradient of a view has all parameters, but the stages leave some out");
  DeviceModel on_device(device, model);
  Renderer renderer(device, stages);
  renderer.set_cameras({camera});
  Buffer<float> target_buffer(device, "target image", target.size());
  target_buffer.upload(target);
  Buffer<float> sums(device, "loss sums", 8);
  Buffer<float> v_params(device, "parameter gradients",
                         static_cast<std::size_t>(on_device.rows()) * on_device.stride());

  renderer.forward(on_device.view(), 0, settings, true);
  stages.image_loss({.shape = renderer.shape(),
                     .image = renderer.image(),
                     .target = {},
                     .target_float = target_buffer.view(),
                     .lambda_dssim = lambda_dssim,
                     .v_image = renderer.v_image(),
                     .sums = sums.view()});
  renderer.backward(v_params.view(), false);

  const std::vector<float> values = sums.download();
  ViewGradient out;
  out.l1 = values[0];
  out.ssim = values[1];
  out.loss = (1.0 - lambda_dssim) * out.l1 + lambda_dssim * (1.0 - out.ssim);
  out.values = download_rows(v_params, on_device.layout(), on_device.count(), on_device.stride());
  return out;
}

}  // namespace ubs
