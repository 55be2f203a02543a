// SPDX-License-Identifier: Apache-2.0
// evaluate() measures the image quality of a model on the views of a split (method.md 4.7): it renders each
// view, clamps the image to [0, 1] and compares it in floating point with the 8-bit ground truth.
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
#include "host/scene/dataset.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/target_images.hpp"

namespace ubs {

struct FittedMetrics {
  double psnr_channel_mean = 0, psnr = 0, ssim = 0;
};

struct ViewMetrics {
  std::string name;
  double psnr_channel_mean = 0;  // mean over the channels of 10 log10(1 / mse), as in the code of the paper
  double psnr = 0;               // from the mse of all channels together
  double ssim = 0;               // zero-padded, 11 x 11 Gaussian
  // SSIM over the windows that are inside the image; only if ImageMetrics were requested.
  std::optional<double> ssim_valid;
  std::vector<NamedValue> lpips;  // one for each network and input range; only if ImageMetrics were requested
  // Values after a fit of the appearance, if one was requested. All other values are without such a fit.
  std::optional<FittedMetrics> fitted;
  std::optional<FittedMetrics> posed;  // from the pose that fits best; only if cameras are refined
  std::string part_of{};               // as View::part_of
};

struct Metrics {
  std::vector<ViewMetrics> views;
  std::vector<ViewMetrics> wide_images;  // wide images, compared in their own lens (measure_wide_images())
  ViewMetrics mean;  // mean over the images, except views that show a part of one of `wide_images`
};

// Computes the metrics of a view from the eight sums of Stages::image_loss.
ViewMetrics view_metrics(const std::string& name, std::span<const float, 8> sums);
// Computes `mean`. It has ssim_valid only if every image has one.
void add_mean(Metrics& metrics);

// Renders and measures every view. `first_camera` is the index of the first view among the renderer's
// cameras. If `more` is given, its metrics are measured too; this waits for the device once per view, and its
// networks take far longer than rendering. If `fit` is given, the function also fits a colour map of this
// kind for each view, which brings the render as close as possible to the photograph, and measures the mapped
// render too.
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more = nullptr, Appearance fit = Appearance::none,
                 Communicator& ranks = alone());
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const SplatView& splats,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more = nullptr, Appearance fit = Appearance::none);

// Measures the wide images that `views` show parts of. From the cameras of the views, it renders the pinhole
// images that WideImage::compose() needs, composes the image, and compares it with the stored one. Returns
// the metrics of the images in the order of their first occurrence. If an image is too large, the function
// prints a warning and skips the image. `more` and `fit` are those of evaluate().
//
// `draw` renders the pinhole images. With several ranks, every rank calls it equally often, and only its
// result on the first rank is used. The other ranks get no metrics.
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

// Measures the views, and metrics.wide_images, again from these cameras of the views and stores the results
// in `posed`. Replaces the renderer's cameras.
void measure_from(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                  const RenderSettings& settings, const std::vector<View>& views,
                  const std::vector<Camera>& cameras, TargetImages& targets, std::uint32_t first_target,
                  Metrics& metrics);

// This overload of evaluate() is for several ranks. They divide the views among them, and all get the same
// result. `draw` renders a view into the renderer. Every rank calls it equally often; surplus calls pass an
// index beyond the last view.
using DrawView = std::function<void(std::size_t view)>;
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const DrawView& draw,
                 Communicator& ranks, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more, Appearance fit);

}  // namespace ubs
