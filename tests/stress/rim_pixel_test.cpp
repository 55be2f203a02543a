// SPDX-License-Identifier: Apache-2.0
// This test shows the cause of the large gradient error in the scene with 1025 splats of
// tests/pipeline/oracle_comparison_test.cpp: four pixels are at the rims of splats with beta < 1. If the
// weights of these four pixels are 0, the error is about a hundred times smaller.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "host/lab/oracle/frame.hpp"
#include "host/lab/oracle/oracle_stages.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "tests/stress/row.hpp"

namespace ubs::stress {
namespace {

constexpr double kRim = 3e-3;  // a pixel with a smaller 1 - r is at the rim of a splat

struct RimScene {
  oracle::Scene scene =
      oracle::regular_scene({.count = 1025, .dim = 6, .seed = 6, .width = 40, .height = 24});
  oracle::Model model = oracle::to_model(scene.model);
  oracle::Options options{.background = scene.background};
  oracle::Frame frame{model, scene.camera, options};
};

// Returns which pixels are at the rim of a splat with beta < 1.
std::vector<bool> rim_pixels(const RimScene& v) {
  std::vector<bool> result;
  oracle::Composited pixel;
  for (int row = 0; row < v.scene.camera.height; ++row) {
    const std::vector<int> candidates = v.frame.reaching_row(row + 0.5);
    for (int column = 0; column < v.scene.camera.width; ++column) {
      oracle::composite(v.frame, candidates, column + 0.5, row + 0.5, v.options, pixel);
      result.push_back(std::ranges::any_of(pixel.list, [&](int k) {
        const oracle::Footprint<double>& f = v.frame.footprints[static_cast<std::size_t>(k)];
        return f.beta < 1 && 1 - oracle::kernel_radius<double>(f, column + 0.5, row + 0.5) < kRim;
      }));
    }
  }
  return result;
}

// Returns the largest relative gradient error of a parameter group.
double gradient_error(const RimScene& v, DeviceRunner& runner, const std::vector<double>& weights) {
  Case c;
  c.model = v.scene.model, c.camera = v.scene.camera;
  for (std::size_t i = 0; i < 3; ++i) c.settings.background[i] = static_cast<float>(v.scene.background[i]);
  const std::vector<float> rounded(weights.begin(), weights.end());
  const std::vector<double> exact = oracle::weighted_gradient(
      v.model, v.scene.camera, std::vector<double>(rounded.begin(), rounded.end()), v.options);
  const std::vector<float> got = runner.run(c, rounded).gradient.values;
  double worst = 0;
  for (const ParameterGroup& group : parameter_groups(v.scene.model.layout())) {
    double difference = 0, norm = 0;
    const std::size_t first = static_cast<std::size_t>(group.first) * v.model.count;
    for (std::size_t i = first; i < first + static_cast<std::size_t>(group.count) * v.model.count; ++i) {
      difference += std::pow(static_cast<double>(got[i]) - exact[i], 2);
      norm += exact[i] * exact[i];
    }
    worst = std::max(worst, std::sqrt(difference / norm));
  }
  return worst;
}

TEST_CASE_METHOD(Row, "four pixels on rims cause the gradient error in the scene with 1025 splats",
                 "[splat]") {
  const RimScene v;
  const std::vector<bool> rim = rim_pixels(v);
  CHECK(std::ranges::count(rim, true) == 4);
  const std::size_t pixels = rim.size();
  const std::vector<double> weights =
      oracle::image_gradient(oracle::render_frame(v.frame, v.scene.camera, v.options).image, v.scene.target,
                             v.scene.camera.width, v.scene.camera.height, loss_weights(0.2f));
  std::vector<double> inner = weights;
  for (std::size_t i = 0; i < 3 * pixels; ++i)
    if (rim[i % pixels]) inner[i] = 0;
  for (const RasterKind raster : {RasterKind::cpu, RasterKind::gpu}) {
    if (raster == RasterKind::cpu && !device().info().has_cpu_raster) continue;
    DeviceRunner runner(device(), raster);
    // The largest errors observed are 6.7e-4 with all pixels and 7.1e-6 without the four pixels. With errors
    // of 3 ulp in divisions, roots and functions (disturbed_test.py), they are 3.3e-3 and 3.4e-5. The bounds
    // are twice the latter. oracle_comparison_test.cpp has smaller bounds for PoCL.
    CHECK(gradient_error(v, runner, weights) < 6.5e-3);
    CHECK(gradient_error(v, runner, inner) < 6.8e-5);
  }
}

}  // namespace
}  // namespace ubs::stress
