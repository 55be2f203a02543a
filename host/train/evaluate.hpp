// SPDX-License-Identifier: Apache-2.0
// evaluate() measures the image quality of a model on the views of a split (method.md 4.7). It renders each
// view, clamps the image to [0, 1], and compares it in floating point with the 8-bit ground truth.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/cluster/communicator.hpp"
#include "host/pipeline/image_metrics.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/appearance_kind.hpp"
#include "host/scene/dataset.hpp"
#include "host/train/target_images.hpp"

namespace ubs {

// Metrics of a render after its colours or its camera pose were fitted to the photograph: see ViewMetrics.
struct FittedMetrics {
  double psnr_channel_mean = 0, psnr = 0, ssim = 0;
};

struct ViewMetrics {
  std::string name;
  double psnr_channel_mean = 0;  // mean of the PSNR of the three channels, as in the published code
  double psnr = 0;               // PSNR from the squared error of all channels together
  double ssim = 0;               // with 11 x 11 Gaussian windows, and zeros outside of the image
  // SSIM over the windows that are completely inside the image. Only present if ImageMetrics were requested.
  std::optional<double> ssim_valid;
  // One LPIPS distance for each network and input range. Empty unless ImageMetrics were requested.
  std::vector<NamedValue> lpips;
  // Metrics after a fit of the appearance, if one was requested. All other metrics are computed without it.
  std::optional<FittedMetrics> fitted;
  // Metrics of the view rendered from the camera pose that fits its photograph best. Only present if cameras
  // are refined.
  std::optional<FittedMetrics> posed;
  std::string part_of{};  // View::part_of of the view
};

struct Metrics {
  std::vector<ViewMetrics> views;
  std::vector<ViewMetrics> wide_images;  // whole wide images: see measure_wide_images()
  // Mean over all images. A view that shows a part of one of `wide_images` is not included, because the wide
  // image is included instead.
  ViewMetrics mean;
};

// Computes the metrics of a view from the eight sums of Stages::image_loss.
ViewMetrics view_metrics(const std::string& name, std::span<const float, 8> sums);
// Computes metrics.mean. Its ssim_valid is only present if every image has one.
void add_mean(Metrics& metrics);

// Renders and measures every view. `first_camera` is the index of the first view among the renderer's cameras
// and in `targets`. If `more` is not null, its metrics are measured too. In this case the function waits for
// the device once per view, and the networks of LPIPS take far longer than rendering. If `fit` is not `none`,
// the function also fits a colour map of this kind for each view, which makes the render as similar as
// possible to the photograph, and measures the mapped render too.
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more = nullptr, Appearance fit = Appearance::none,
                 Communicator& ranks = alone());
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const SplatView& splats,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more = nullptr, Appearance fit = Appearance::none);

// Measures the wide images of which `views` show parts. For each of them, it renders the pinhole images that
// WideImage::compose() needs, composes an image with the wide lens, and compares this with the image file.
// Returns the metrics of the images in the order of their first occurrence. If an image is too large, the
// function prints a warning and skips the image. Images in which all pixels are masked are skipped too.
// `more` and `fit` have the same meaning as in evaluate().
//
// `draw` renders the pinhole images. With several ranks, all ranks call it the same number of times, and only
// its result on the first rank is used. The function returns an empty result on the other ranks.
using DrawFaces = std::function<std::vector<RenderedView>(const std::vector<Camera>& faces)>;
std::vector<ViewMetrics> measure_wide_images(Device& device, Stages& stages, const DrawFaces& draw,
                                             Communicator& ranks, const std::vector<View>& views,
                                             const std::vector<Camera>& cameras, ImageMetrics* more,
                                             Appearance fit);
// This overload renders with `renderer` and replaces its cameras.
std::vector<ViewMetrics> measure_wide_images(Device& device, Stages& stages, Renderer& renderer,
                                             std::span<const RenderGroup> groups,
                                             const RenderSettings& settings, const std::vector<View>& views,
                                             const std::vector<Camera>& cameras, ImageMetrics* more = nullptr,
                                             Appearance fit = Appearance::none);

// Measures the views and metrics.wide_images again with the camera poses `cameras`, one per view, and stores
// the results as ViewMetrics::posed. `first_target` is the index of the photograph of the first view in
// `targets`. Replaces the renderer's cameras.
void measure_from(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                  const RenderSettings& settings, const std::vector<View>& views,
                  const std::vector<Camera>& cameras, TargetImages& targets, std::uint32_t first_target,
                  Metrics& metrics);

// In this overload of evaluate(), the caller renders the views: `draw` renders a view with the renderer. With
// several ranks, each rank measures some of the views, and all ranks return the same result. All ranks call
// `draw` the same number of times. If a rank has fewer views than others, it also calls `draw` with an index
// after the last view.
using DrawView = std::function<void(std::size_t view)>;
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const DrawView& draw,
                 Communicator& ranks, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more, Appearance fit);

}  // namespace ubs
