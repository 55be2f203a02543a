// SPDX-License-Identifier: Apache-2.0
// expected_gradient() computes the float64 gradient of a weighted sum of the colours, alphas and depths of a
// rendered view. The oracle does not output the gradient of alpha, so it is derived from two backgrounds: in
// the red channel, the image in front of (1, 0, 0) minus that in front of (0, 0, 0) is 1 - alpha.
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "host/base/philox.hpp"
#include "host/lab/oracle/oracle.hpp"
#include "host/lab/oracle/scenes.hpp"

namespace ubs::test {

struct Weights {
  std::vector<float> rgb, alpha, depth;  // (H, W, 3), (H, W), (H, W); or empty
};

// Returns the gradient of a weighted sum of all pixels: each colour, alpha and depth is multiplied by its
// weight. If `query_grad` is true, the gradient includes the dependence of the view direction on the
// position.
inline oracle::ViewGradients expected_gradient(const oracle::Scene& scene, const Weights& weights,
                                               bool query_grad = false) {
  const oracle::Model model = oracle::to_model(scene.model);
  const auto pixels = static_cast<std::size_t>(scene.camera.width * scene.camera.height);
  oracle::ViewGradients sum{std::vector<double>(model.values.size(), 0.0), {}};
  const auto add = [&](const std::vector<double>& colour, const std::vector<double>& depth,
                       std::array<double, 3> background, double sign) {
    const oracle::ViewGradients part = oracle::view_gradients(
        model, scene.camera, colour, depth,
        {.background = background, .query_grad = query_grad, .variant = scene.model.variant});
    for (std::size_t i = 0; i < sum.values.size(); ++i) sum.values[i] += sign * part.values[i];
    for (std::size_t i = 0; i < sum.camera.size(); ++i) sum.camera[i] += sign * part.camera[i];
  };
  std::vector<double> w(3 * pixels, 0.0);
  if (!weights.rgb.empty() || !weights.depth.empty()) {
    for (std::size_t c = 0; c < 3 && !weights.rgb.empty(); ++c)
      for (std::size_t i = 0; i < pixels; ++i)
        w[c * pixels + i] = static_cast<double>(weights.rgb[3 * i + c]);
    add(w, std::vector<double>(weights.depth.begin(), weights.depth.end()), scene.background, 1);
  }
  if (!weights.alpha.empty()) {
    w.assign(3 * pixels, 0.0);
    for (std::size_t i = 0; i < pixels; ++i) w[i] = static_cast<double>(weights.alpha[i]);
    add(w, {}, {0, 0, 0}, 1);
    add(w, {}, {1, 0, 0}, -1);
  }
  return sum;
}

// Returns a scene with 150 splats in front of a coloured background, and random weights, some of which are 0.
inline std::pair<oracle::Scene, Weights> differentiable_view(int dim, int width, int height,
                                                             const ModelVariant& variant = {}) {
  oracle::SceneOptions options{.count = 150,
                               .dim = dim,
                               .seed = static_cast<std::uint64_t>(dim),
                               .width = width,
                               .height = height,
                               .variant = variant};
  oracle::Scene scene = oracle::regular_scene(options);
  scene.background = {0.2, 0.7, 0.4};
  const CounterRandom random(5, 1);
  Weights all;
  for (std::uint32_t i = 0; i < static_cast<std::uint32_t>(width * height); ++i) {
    // The weights of colours, alpha and depth are 0 at different pixels.
    for (std::uint32_t c = 0; c < 3; ++c)
      all.rgb.push_back(i % 3 == 0 ? 0.0f : static_cast<float>(random.uniform(i, c, -1, 1)));
    all.alpha.push_back(i % 4 == 1 ? 0.0f : static_cast<float>(random.uniform(i, 3, -1, 1)));
    all.depth.push_back(i % 5 == 2 ? 0.0f : static_cast<float>(random.uniform(i, 4, -1, 1)));
  }
  return {std::move(scene), std::move(all)};
}

}  // namespace ubs::test
