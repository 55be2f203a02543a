// SPDX-License-Identifier: Apache-2.0
#include "host/train/evaluate.hpp"

#include <cmath>

#include "host/base/error.hpp"

namespace ubs {
namespace {

double psnr_of(double mse) { return -10.0 * std::log10(mse); }

ViewMetrics view_metrics(const std::string& name, std::span<const float, 8> sums) {
  ViewMetrics m;
  m.name = name;
  m.ssim = sums[1];
  m.psnr = psnr_of((sums[2] + sums[3] + sums[4]) / 3.0);
  m.psnr_channel_mean = (psnr_of(sums[2]) + psnr_of(sums[3]) + psnr_of(sums[4])) / 3.0;
  return m;
}

}  // namespace

Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const SplatView& splats,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera) {
  const RenderGroup group{&stages, splats};
  return evaluate(device, stages, renderer, std::span(&group, 1), settings, views, targets, first_camera);
}

Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera) {
  Metrics metrics;
  Buffer<float> sums(device, "metric sums", 8 * views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto camera = first_camera + static_cast<std::uint32_t>(i);
    if (i + 1 < views.size()) targets.prefetch(camera + 1);
    renderer.forward(groups, camera, settings, false);
    stages.image_loss({.shape = renderer.shape(),
                       .image = renderer.image(),
                       .target = targets.get(camera),
                       .target_float = {},
                       .clamp = true,
                       .v_image = {},
                       .sums = sums.view(),
                       .sums_offset = static_cast<std::uint32_t>(8 * i)});
  }
  const std::vector<float> values = sums.download();
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::span<const float, 8> row(values.data() + 8 * i, 8);
    for (const float value : row.first<5>())
      if (!std::isfinite(value))
        fail(ErrorKind::numerical, "the render of view '{}' is not finite; look at the model with 'ubs info'",
             views[i].name);
    metrics.views.push_back(view_metrics(views[i].name, row));
  }
  metrics.mean.name = "mean";
  for (const ViewMetrics& m : metrics.views) {
    metrics.mean.psnr += m.psnr / static_cast<double>(views.size());
    metrics.mean.psnr_channel_mean += m.psnr_channel_mean / static_cast<double>(views.size());
    metrics.mean.ssim += m.ssim / static_cast<double>(views.size());
  }
  return metrics;
}

}  // namespace ubs
