// SPDX-License-Identifier: Apache-2.0
// Image quality of a model on the views of a split (method.md 4.7): the render is clamped to [0, 1] and
// compared in floating point with the 8-bit ground truth.
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
  double psnr_channel_mean = 0;  // mean over channels of 10 log10(1 / mse), as the paper's code has it
  double psnr = 0;               // of the joint mse
  double ssim = 0;               // zero-padded, 11 x 11 Gaussian
  std::optional<double>
      ssim_valid;                 // over the windows inside of the image; where ImageMetrics were asked for
  std::vector<NamedValue> lpips;  // likewise, of each network and input range
  std::optional<FittedMetrics> fitted;  // where asked for; the other numbers are of the render as it is
  std::optional<FittedMetrics> posed;   // from the pose that fits best, where cameras are refined
};

struct Metrics {
  std::vector<ViewMetrics> views;
  ViewMetrics mean;  // of the views' values
};

// From the eight sums of Stages::image_loss.
ViewMetrics view_metrics(const std::string& name, std::span<const float, 8> sums);
// Averages the views into `mean`; ssim_valid only where every view has one.
void add_mean(Metrics& metrics);

// Renders every view and measures it. `first_camera` is the renderer's index of the first view. What `more`
// measures makes the device wait once a view, and a network takes far longer than drawing. `fit`: measures
// again after the colour map of this kind that fits the render best to the image.
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more = nullptr, Appearance fit = Appearance::none,
                 Communicator& ranks = alone());
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const SplatView& splats,
                 const RenderSettings& settings, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more = nullptr, Appearance fit = Appearance::none);

// The views again from these cameras, into `posed`. Replaces the renderer's cameras.
void measure_from(Device& device, Stages& stages, Renderer& renderer, std::span<const RenderGroup> groups,
                  const RenderSettings& settings, const std::vector<Camera>& cameras, TargetImages& targets,
                  std::uint32_t first_target, Metrics& metrics);

// Several ranks share the views, and all get the same answer. `draw` brings a view into the renderer; it is
// called equally often on every rank, at the end with numbers behind the last view.
using DrawView = std::function<void(std::size_t view)>;
Metrics evaluate(Device& device, Stages& stages, Renderer& renderer, const DrawView& draw,
                 Communicator& ranks, const std::vector<View>& views, TargetImages& targets,
                 std::uint32_t first_camera, ImageMetrics* more, Appearance fit);

}  // namespace ubs
