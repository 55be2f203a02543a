// SPDX-License-Identifier: Apache-2.0
#include "host/model/picture.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "host/base/error.hpp"
#include "host/dataset/image.hpp"

namespace ubs {
namespace {

// Returns the 256 colours (R, G, B) of the Turbo colour map.
const cv::Mat3b& turbo() {
  static const cv::Mat3b table = [] {
    cv::Mat1b levels(1, 256);
    for (int i = 0; i < 256; ++i) levels(0, i) = static_cast<std::uint8_t>(i);
    cv::Mat coloured;
    cv::applyColorMap(levels, coloured, cv::COLORMAP_TURBO);
    cv::cvtColor(coloured, coloured, cv::COLOR_BGR2RGB);
    return cv::Mat3b(coloured);
  }();
  return table;
}

Image8 alpha_picture(const RenderedView& view) {
  std::vector<float> grey;
  grey.reserve(3 * view.alpha.size());
  for (const float a : view.alpha) grey.insert(grey.end(), 3, a);
  return image_from_interleaved(grey, view.width, view.height);
}

Image8 depth_picture(const RenderedView& view, const DepthRange& range) {
  std::vector<float> colours;
  colours.reserve(3 * view.depth.size());
  for (std::size_t i = 0; i < view.depth.size(); ++i) {
    const float alpha = view.alpha[i], z = view.depth[i];
    if (!std::isfinite(z)) fail(ErrorKind::numerical, "the depth of pixel {} is {}", i, z);
    const float nearness =
        range.empty() ? 0.5f : std::clamp((range.far - z) / (range.far - range.near), 0.0f, 1.0f);
    const cv::Vec3b& colour = turbo()(0, static_cast<int>(nearness * 255.0f + 0.5f));
    for (int c = 0; c < 3; ++c) colours.push_back(alpha * static_cast<float>(colour[c]) / 255.0f);
  }
  return image_from_interleaved(colours, view.width, view.height);
}

}  // namespace

DepthRange depth_percentiles(std::vector<float> depths) {
  if (depths.empty()) return {};
  const auto at = [&](double q) {
    const auto place = depths.begin() + std::lround(q * static_cast<double>(depths.size() - 1));
    std::ranges::nth_element(depths, place);
    return *place;
  };
  const float near = at(0.01);
  return {near, at(0.99)};
}

DepthRange depth_range(const RenderedView& view) {
  std::vector<float> depths;
  for (std::size_t i = 0; i < view.depth.size(); ++i)
    if (view.alpha[i] > 0.5f && std::isfinite(view.depth[i])) depths.push_back(view.depth[i]);
  return depth_percentiles(std::move(depths));
}

DepthRange united(const DepthRange& a, const DepthRange& b) {
  if (a.empty() || b.empty()) return a.empty() ? b : a;
  return {std::min(a.near, b.near), std::max(a.far, b.far)};
}

Image8 picture(const RenderedView& view, Channel channel, const DepthRange& range) {
  if (channel == Channel::rgb) return image_from_interleaved(view.rgb, view.width, view.height);
  if (channel == Channel::alpha) return alpha_picture(view);
  return depth_picture(view, range);
}

}  // namespace ubs
