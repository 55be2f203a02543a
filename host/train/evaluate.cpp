// SPDX-License-Identifier: Apache-2.0
#include "host/train/evaluate.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/json.hpp"
#include "host/base/warning.hpp"
#include "host/pipeline/masked_metrics.hpp"
#include "host/scene/wide_image.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/fit_appearance.hpp"
#include "host/train/target_loss.hpp"

namespace ubs {
namespace {

double psnr_of(double mse) { return -10.0 * std::log10(mse); }

// Compared refers to an image on the device and to the photograph that it is compared with.
struct Compared {
  ImageShape shape;
  BufferView<float> values;  // (3, rows, pitch)
  Target target;
};

PhotographPixels images_of(Device& device, const Target& target, const ImageShape& shape) {
  const std::size_t pixels = static_cast<std::size_t>(shape.width) * static_cast<std::size_t>(shape.height);
  PhotographPixels p{read_values(device, target.image, 3 * pixels), {}};
  if (target.mask.size > 0) p.mask = read_values(device, target.mask, pixels);
  return p;
}

// Computes the metrics of `more` for a view with a mask. SSIM is computed on the host, which can skip windows
// that contain masked pixels. LPIPS is computed on an image in which masked pixels have the values of the
// photograph.
void measure_masked(Device& device, ImageMetrics& more, const Compared& compared, ViewMetrics& view) {
  const auto& [shape, values, target] = compared;
  const PlanarSize size{shape.width, shape.height};
  const std::size_t pixels = static_cast<std::size_t>(shape.width) * static_cast<std::size_t>(shape.height);
  const std::vector<std::uint8_t> mask = read_values(device, target.mask, pixels),
                                  bytes = read_values(device, target.image, 3 * pixels);
  std::vector<float> image = cropped_planes(read_values(device, values, values.size), shape);
  std::vector<float> truth(3 * pixels);
  for (std::size_t i = 0; i < 3 * pixels; ++i) {
    image[i] = std::clamp(image[i], 0.0f, 1.0f);
    truth[i] = static_cast<float>(bytes[i]) / 255.0f;
  }
  view.ssim_valid = masked_valid_ssim(image, truth, mask, size);
  Buffer<float> filled(device, "image with masked pixels replaced", 3 * shape.plane());
  filled.upload(padded_planes(fill_masked(image, truth, mask), shape));
  view.lpips =
      more.lpips({.size = size, .values = filled.view(), .pitch = shape.pitch(), .rows = shape.rows()},
                 {.size = size, .bytes = target.image});
}

void measure_more(Device& device, ImageMetrics& more, const Compared& compared, ViewMetrics& view) {
  const auto& [shape, values, target] = compared;
  if (target.mask.size > 0) return measure_masked(device, more, compared, view);
  const PlanarSize size{shape.width, shape.height};
  const DeviceImage drawn{.size = size, .values = values, .pitch = shape.pitch(), .rows = shape.rows()};
  const DeviceImage truth{.size = size, .bytes = target.image};
  view.ssim_valid = more.valid_ssim(drawn, truth);
  view.lpips = more.lpips(drawn, truth);
}

// Throws an error if one of the first five sums of Stages::image_loss is not finite. These are the L1 error,
// SSIM, and the squared errors of the three channels.
void check_finite(std::span<const float, 8> sums, const std::string& view) {
  for (const float value : sums.first<5>())
    if (!std::isfinite(value))
      fail(ErrorKind::numerical,
           "the render of view '{}' contains values that are not finite: check the model with 'ubs info'",
           view);
}

FittedMetrics fitted_metrics(std::span<const float, 8> sums) {
  const ViewMetrics m = view_metrics({}, sums);
  return {m.psnr_channel_mean, m.psnr, m.ssim};
}

// Compares a composed image with the image file, which has a mask. Both are in host memory.
ViewMetrics compare_wide(Device& device, Stages& stages, const std::string& name,
                         const RenderedView& composed, const Image8& file, ImageMetrics* more,
                         Appearance fit) {
  const ImageShape shape{composed.width, composed.height};
  Buffer<float> values(device, "composed image", 3 * shape.plane()), sums(device, "metric sums", 8);
  values.upload(padded_planes(planar(composed.rgb), shape));
  Buffer<std::uint8_t> image(device, "wide image", file.rgb.size()), mask(device, "mask", file.mask.size());
  image.upload(planar(file.rgb));
  mask.upload(file.mask);
  const Compared compared{
      shape,
      values.view(),
      {image.view(), mask.view(),
       static_cast<std::uint32_t>(file.mask.size() -
                                  static_cast<std::size_t>(std::ranges::count(file.mask, 0)))}};
  ImageLoss loss = loss_of(shape, values.view(), compared.target, sums.view());
  loss.clamp = true;
  stages.image_loss(loss);
  const std::vector<float> row = sums.download();
  check_finite(std::span<const float, 8>(row), name);
  ViewMetrics metrics = view_metrics(name, std::span<const float, 8>(row));
  if (more) measure_more(device, *more, compared, metrics);
  if (fit != Appearance::none) {
    Buffer<float> appearance(device, "fitted appearance", kAppearanceNumbers);
    appearance.upload(fit_appearance(composed, images_of(device, compared.target, shape), fit));
    loss.appearance = appearance.view();
    stages.image_loss(loss);
    metrics.fitted = fitted_metrics(std::span<const float, 8>(sums.download()));
  }
  return metrics;
}

// Calls `step`, which is a part of measuring a wide image. If it throws an error because the image is too
// large, prints a warning instead.
template <typename Step>
void unless_too_large(const Step& step) {
  try {
    step();
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::memory && error.kind() != ErrorKind::usage) throw;
    warn_once(
        fmt::format("wide images are only compared in views that show parts of them: {}", error.what()));
  }
}

// Sends the results of measure_more() to all ranks. Each view was measured by the rank that rendered it. The
// results are sent as JSON, which preserves every bit of a double.
void share_more(Communicator& ranks, std::vector<ViewMetrics>& views) {
  if (ranks.size() == 1) return;
  const auto size = static_cast<std::size_t>(ranks.size());
  Json own = Json::array();
  for (std::size_t i = static_cast<std::size_t>(ranks.rank()); i < views.size(); i += size) {
    Json lpips = Json::array();
    for (const NamedValue& value : views[i].lpips) lpips.push_back({value.name, value.value});
    own.push_back({views[i].ssim_valid ? Json(*views[i].ssim_valid) : Json(nullptr), std::move(lpips)});
  }
  const std::vector<std::string> texts = ranks.all_texts(json_text(own));
  for (std::size_t r = 0; r < size; ++r) {
    const Json theirs = parse_own_json(texts[r], "metrics of another rank");
    for (std::size_t i = r; i < views.size(); i += size) {
      const Json& view = theirs.at(i / size);
      if (!view[0].is_null()) views[i].ssim_valid = view[0].get<double>();
      views[i].lpips.clear();
      for (const Json& value : view[1])
        views[i].lpips.push_back({value[0].get<std::string>(), value[1].get<double>()});
    }
  }
}

}  // namespace

void measure_from(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                  const RenderSettings& settings, const std::vector<View>& views,
                  const std::vector<Camera>& cameras, TargetImages& targets, std::uint32_t first_target,
                  Metrics& metrics) {
  for (const ViewMetrics& again :
       measure_wide_images(device, stages, renderer, groups, settings, views, cameras)) {
    const auto image = std::ranges::find(metrics.wide_images, again.name, &ViewMetrics::name);
    if (image != metrics.wide_images.end()) image->posed = {again.psnr_channel_mean, again.psnr, again.ssim};
  }
  renderer.set_cameras(cameras);
  Buffer<float> sums(device, "metric sums", 8 * cameras.size());
  for (std::uint32_t i = 0; i < cameras.size(); ++i) {
    renderer.forward(groups, i, settings, false);
    ImageLoss loss = loss_of(renderer, targets.get(first_target + i), sums.view());
    loss.clamp = true;
    loss.sums_offset = 8 * i;
    stages.image_loss(loss);
  }
  const std::vector<float> values = sums.download();
  for (std::size_t i = 0; i < cameras.size(); ++i)
    metrics.views[i].posed = fitted_metrics(std::span<const float, 8>(values.data() + 8 * i, 8));
  add_mean(metrics);
}

std::vector<ViewMetrics> measure_wide_images(Device& device, Stages& stages, const DrawFaces& draw,
                                             Communicator& ranks, const std::vector<View>& views,
                                             const std::vector<Camera>& cameras, ImageMetrics* more,
                                             Appearance fit) {
  std::vector<ViewMetrics> images;
  for (const auto& parts : views_by_image(views)) {
    const View& view = views[parts[0]];
    if (!view.wide) continue;
    const Camera camera = camera_of_wide_image(view, cameras[parts[0]]);
    Image8 image;
    std::vector<Camera> faces;
    if (ranks.first())
      unless_too_large([&] {
        image = view.wide->load();
        if (std::ranges::count(image.mask, 0) < std::ssize(image.mask)) faces = view.wide->faces(camera);
      });
    std::uint64_t measured = faces.empty() ? 0 : 1;
    ranks.sum(std::span(&measured, 1));
    if (measured == 0) continue;
    if (!ranks.first()) faces = view.wide->faces(camera);
    const std::vector<RenderedView> renders = draw(faces);
    if (ranks.first())
      unless_too_large([&] {
        const RenderedView composed = view.wide->compose(renders);
        images.push_back(compare_wide(device, stages, view.part_of, composed, image, more, fit));
      });
  }
  return images;
}

std::vector<ViewMetrics> measure_wide_images(Device& device, Stages& stages, Renderer& renderer,
                                             std::span<const RenderGroup> groups,
                                             const RenderSettings& settings, const std::vector<View>& views,
                                             const std::vector<Camera>& cameras, ImageMetrics* more,
                                             Appearance fit) {
  const auto draw = [&](const std::vector<Camera>& faces) {
    renderer.set_cameras(faces);
    std::vector<RenderedView> renders;
    for (std::uint32_t i = 0; i < faces.size(); ++i) {
      renderer.forward(groups, i, settings, false);
      renders.push_back(renderer.download());
    }
    return renders;
  };
  return measure_wide_images(device, stages, draw, alone(), views, cameras, more, fit);
}

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
  std::vector<ViewMetrics> images = metrics.wide_images;
  for (const ViewMetrics& view : metrics.views)
    if (view.part_of.empty() ||
        std::ranges::find(metrics.wide_images, view.part_of, &ViewMetrics::name) == metrics.wide_images.end())
      images.push_back(view);
  if (images.empty()) return;
  const double weight = 1 / static_cast<double>(images.size());
  ViewMetrics& mean = metrics.mean;
  mean.ssim_valid = 0;
  mean.lpips = images[0].lpips;
  for (NamedValue& value : mean.lpips) value.value = 0;
  for (const ViewMetrics& m : images) {
    mean.psnr += m.psnr / static_cast<double>(images.size());
    mean.psnr_channel_mean += m.psnr_channel_mean / static_cast<double>(images.size());
    mean.ssim += m.ssim / static_cast<double>(images.size());
    for (const auto which : {&ViewMetrics::fitted, &ViewMetrics::posed}) {
      const std::optional<FittedMetrics>& own = m.*which;
      std::optional<FittedMetrics>& sum = mean.*which;
      if (!own) continue;
      if (!sum) sum = FittedMetrics{};
      sum->psnr_channel_mean += own->psnr_channel_mean * weight;
      sum->psnr += own->psnr * weight;
      sum->ssim += own->ssim * weight;
    }
    if (!m.ssim_valid) mean.ssim_valid = std::nullopt;
    if (mean.ssim_valid) *mean.ssim_valid += *m.ssim_valid * weight;
    for (std::size_t i = 0; i < m.lpips.size(); ++i) mean.lpips[i].value += m.lpips[i].value * weight;
  }
}

Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const SplatView& splats,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more, Appearance fit) {
  const RenderGroup group{&stages, splats};
  return evaluate(device, stages, renderer, std::span(&group, 1), settings, views, targets, first_camera,
                  more, fit);
}

Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more, Appearance fit, Communicator& ranks) {
  const auto draw = [&](std::size_t i) {
    if (i < views.size())
      renderer.forward(groups, first_camera + static_cast<std::uint32_t>(i), settings, false);
  };
  return evaluate(device, stages, renderer, draw, ranks, views, targets, first_camera, more, fit);
}

Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const DrawView& draw,
                 Communicator& ranks, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more, Appearance fit) {
  Metrics metrics;
  metrics.views.resize(views.size());
  // The buffer first contains the sums for the unchanged renders of all views, and then those for the renders
  // after the appearance fit.
  Buffer<float> sums(device, "metric sums", (fit == Appearance::none ? 8 : 16) * views.size());
  if (ranks.size() > 1) sums.zero();
  Buffer<float> appearance;
  if (fit != Appearance::none) appearance = {device, "fitted appearance", kAppearanceNumbers};
  const auto size = static_cast<std::size_t>(ranks.size()), rank = static_cast<std::size_t>(ranks.rank());
  for (std::size_t i = rank; i < (views.size() + size - 1) / size * size; i += size) {
    const auto camera = first_camera + static_cast<std::uint32_t>(i);
    if (i + size < views.size()) targets.prefetch(camera + static_cast<std::uint32_t>(size));
    draw(i);
    if (i >= views.size()) continue;
    const Target target = targets.get(camera);
    if (target.mask.size > 0 && target.counted == 0)
      fail(ErrorKind::data, "view '{}': its mask leaves no pixel to compare", views[i].name);
    ImageLoss loss = loss_of(renderer, target, sums.view());
    loss.clamp = true;
    loss.sums_offset = static_cast<std::uint32_t>(8 * i);
    stages.image_loss(loss);
    if (fit != Appearance::none) {
      appearance.upload(
          fit_appearance(renderer.download(), images_of(device, target, renderer.shape()), fit));
      loss.appearance = appearance.view();
      loss.sums_offset += static_cast<std::uint32_t>(8 * views.size());
      stages.image_loss(loss);
    }
    if (more) measure_more(device, *more, {renderer.shape(), renderer.image(), target}, metrics.views[i]);
  }
  std::vector<float> values = sums.download();
  ranks.merge(values);
  share_more(ranks, metrics.views);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::span<const float, 8> row(values.data() + 8 * i, 8);
    check_finite(row, views[i].name);
    ViewMetrics view = view_metrics(views[i].name, row);
    view.part_of = views[i].part_of;
    view.ssim_valid = metrics.views[i].ssim_valid;
    view.lpips = std::move(metrics.views[i].lpips);
    if (fit != Appearance::none)
      view.fitted = fitted_metrics(std::span<const float, 8>(values.data() + 8 * (views.size() + i), 8));
    metrics.views[i] = std::move(view);
  }
  add_mean(metrics);
  return metrics;
}

}  // namespace ubs
