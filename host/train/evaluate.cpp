// SPDX-License-Identifier: Apache-2.0
#include "host/train/evaluate.hpp"

#include <cmath>

#include "host/base/error.hpp"

namespace ubs {
namespace {

double psnr_of(double mse) { return -10.0 * std::log10(mse); }

// Both images of the view drawn last.
void measure_more(ImageMetrics& more, const Renderer& renderer, View1<std::uint8_t> target, ViewMetrics& view) {
  const ImageShape shape = renderer.shape();
  const PlanarSize size{shape.width, shape.height};
  const DeviceImage drawn{.size = size, .values = renderer.image(), .pitch = shape.pitch(), .rows = shape.rows()};
  const DeviceImage truth{.size = size, .bytes = target};
  view.ssim_valid = more.valid_ssim(drawn, truth);
  view.lpips = more.lpips(drawn, truth);
}

}  // namespace

ViewMetrics view_metrics(const std::string& name, std::span<const float, 8> sums) {
  ViewMetrics m;
  m.name = name;
  m.ssim = sums[1];
  m.psnr = psnr_of((sums[2] + sums[3] + sums[4]) / 3.0);
  m.psnr_channel_mean = (psnr_of(sums[2]) + psnr_of(sums[3]) + psnr_of(sums[4])) / 3.0;
  return m;
}

void add_mean(Metrics& metrics) {
  metrics.mean = {.name = "mean"};
  if (metrics.views.empty()) return;
  const double weight = 1 / static_cast<double>(metrics.views.size());
  ViewMetrics& mean = metrics.mean;
  mean.ssim_valid = 0;
  mean.lpips = metrics.views[0].lpips;
  for (NamedValue& value : mean.lpips) value.value = 0;
  for (const ViewMetrics& m : metrics.views) {
    mean.psnr += m.psnr / static_cast<double>(metrics.views.size());
    mean.psnr_channel_mean += m.psnr_channel_mean / static_cast<double>(metrics.views.size());
    mean.ssim += m.ssim / static_cast<double>(metrics.views.size());
    if (!m.ssim_valid) mean.ssim_valid = std::nullopt;
    if (mean.ssim_valid) *mean.ssim_valid += *m.ssim_valid * weight;
    for (std::size_t i = 0; i < m.lpips.size(); ++i) mean.lpips[i].value += m.lpips[i].value * weight;
  }
}

Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const SplatView& splats,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more) {
  const RenderGroup group{&stages, splats};
  return evaluate(device, stages, renderer, std::span(&group, 1), settings, views, targets, first_camera, more);
}

Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more) {
  Metrics metrics;
  metrics.views.resize(views.size());
  Buffer<float> sums(device, "metric sums", 8 * views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto camera = first_camera + static_cast<std::uint32_t>(i);
    if (i + 1 < views.size()) targets.prefetch(camera + 1);
    renderer.forward(groups, camera, settings, false);
    const View1<std::uint8_t> target = targets.get(camera);
    stages.image_loss({.shape = renderer.shape(),
                       .image = renderer.image(),
                       .target = target,
                       .target_float = {},
                       .clamp = true,
                       .v_image = {},
                       .sums = sums.view(),
                       .sums_offset = static_cast<std::uint32_t>(8 * i)});
    if (more) measure_more(*more, renderer, target, metrics.views[i]);
  }
  const std::vector<float> values = sums.download();
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::span<const float, 8> row(values.data() + 8 * i, 8);
    for (const float value : row.first<5>())
      if (!std::isfinite(value))
        fail(ErrorKind::numerical, "the render of view '{}' is not finite; look at the model with 'ubs info'",
             views[i].name);
    ViewMetrics view = view_metrics(views[i].name, row);
    view.ssim_valid = metrics.views[i].ssim_valid;
    view.lpips = std::move(metrics.views[i].lpips);
    metrics.views[i] = std::move(view);
  }
  add_mean(metrics);
  return metrics;
}

}  // namespace ubs
