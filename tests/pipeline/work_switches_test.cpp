// SPDX-License-Identifier: Apache-2.0
// Tests the work that kernels skip: blocks and splats without effect on the image and, with the setting
// alpha_min, also contributions with a smaller alpha. Images and gradients must agree with float64, and the
// error that alpha_min causes must be within the bound that is derived below.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <catch2/catch.hpp>

#include "host/base/error.hpp"
#include "host/lab/oracle/oracle.hpp"
#include "host/pipeline/capture_stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "host/settings/train_settings.hpp"
#include "tests/pipeline/oracle_comparison.hpp"
#include "tests/support/compare.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/oracle_scene.hpp"
#include "tests/support/published.hpp"

namespace ubs {
namespace {

constexpr std::size_t kOpaque = 200;  // number of splats of the opaque scene

oracle::Scene scene_of(ModelVariant variant = {}, std::size_t count = 400) {
  oracle::Scene scene = oracle::regular_scene(
      {.count = count, .dim = 4, .seed = 3, .width = 93, .height = 71, .variant = variant});
  // Steep rims would hide errors, see variant_scene() in variant_test.cpp.
  if (variant.has_spatial_beta())
    for (float& b : scene.model.row(scene.model.layout().beta)) b = std::max(b, -0.5f);
  return scene;
}

// Returns opaque layers, so that pixels, blocks and tiles finish early.
oracle::Scene opaque_scene() {
  return oracle::opaque_stack_scene({.count = kOpaque, .dim = 4, .seed = 5, .width = 61, .height = 45});
}

struct DrawnView {
  std::vector<float> image, alpha, gradient;
  ListTotals totals;
  std::size_t blocks = 0;  // number of 4x4 blocks that are set in the masks of all intersections
};

DrawnView view_of(Device& device, const oracle::Scene& scene, RasterKind raster, float alpha_min = 0) {
  KernelConfig config{.dim = scene.model.dim, .raster = raster, .variant = scene.model.variant};
  config.alpha_min = alpha_min;
  CaptureStages stages(make_stages(device, config));
  const RenderSettings settings = test::settings_of(scene);
  DrawnView view;
  view.gradient =
      view_gradient(device, stages, scene.model, scene.camera, test::target_of(scene), settings, 0.2f)
          .values.values;
  Renderer renderer(device, stages);
  renderer.set_cameras({scene.camera});
  const DeviceModel model(device, scene.model);
  view.totals = renderer.forward(model.view(), 0, settings, true);
  std::vector<std::uint16_t> masks(view.totals.intersections);
  device.read(*stages.last<RasterForward>().masks.memory, 0, std::as_writable_bytes(std::span(masks)));
  for (const std::uint16_t mask : masks) view.blocks += static_cast<std::size_t>(std::popcount(mask));
  const RenderedView rendered = renderer.download();
  view.image = rendered.rgb;
  view.alpha = rendered.alpha;
  return view;
}

// Tests opaque layers, so that pixels, blocks and tiles finish early, and a scene without them.
TEST_CASE("a view skips work without effect", "[work]") {
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device))
      for (const oracle::Scene& scene : {scene_of(), opaque_scene()}) {
        INFO(device->info().name << ", raster " << test::text(raster));
        const DrawnView view = view_of(*device, scene, raster);
        REQUIRE(std::ranges::any_of(view.gradient, [](float v) { return v != 0; }));
        const oracle::Render all =
            oracle::render(oracle::to_model(scene.model), scene.camera, {.background = scene.background});
        // Alpha must contain all contributions, although at least half of the blocks are skipped.
        double most = 0;
        for (std::size_t i = 0; i < view.alpha.size(); ++i)
          most = std::max(most, std::abs(view.alpha[i] - all.alpha[i]));
        CHECK(most < 1e-4);
        CHECK(view.blocks > 0);
        CHECK(view.blocks < 8 * view.totals.intersections);
      }
}

TEST_CASE("alpha_min agrees with float64 in images and gradients", "[work][oracle]") {
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device))
      for (const ModelVariant& variant : {ModelVariant{}, ModelVariant{.kernel = SpatialKernel::gaussian}}) {
        if (rasters_of(*device).size() > 1 && raster == RasterKind::gpu &&
            variant.kernel == SpatialKernel::gaussian)
          continue;
        KernelConfig config{.dim = 4, .raster = raster, .variant = variant};
        config.alpha_min = 0.02f;
        const test::Case c{*device, config, ""};
        const oracle::Scene scene = scene_of(variant, 200);
        const std::string name = "alpha_min " + to_string(variant);
        // The largest errors observed are 1.5e-6 for alpha, and 1.8e-6 for the gradient of xyz.
        test::compare_forward(c, name, scene, 2.1e-6);
        test::compare_gradient(c, name, scene, 3.6e-6);
      }
}

// Let R be the range of all colours and the background. Skipping a contribution changes the pixel by T alpha
// (c minus b), where T is the transmittance in front of the splat, c its colour, and b the colour of
// everything behind it. This is at most alpha_min R, so skipping n contributions changes the pixel by at most
// n alpha_min R. It also makes the transmittance larger, so that blending may stop at another splat. If
// blending stops at a transmittance S, the rest is ignored, which changes the pixel by at most S R. This
// happens with alpha_min (S) and without it (S'). Hence the difference between the two images is at most R (n
// alpha_min + S + S').
TEST_CASE("the error of alpha_min stays within its bound", "[work]") {
  for (const auto& device : devices_under_test())
    for (const float more_opacity : {0.0f, 5.0f})  // with 5, blending stops early at more pixels
      for (const float alpha_min : {1.0f / 255, 0.02f}) {
        oracle::Scene scene = scene_of();
        for (float& raw : scene.model.row(scene.model.layout().opacity)) raw += more_opacity;
        const RasterKind raster = raster_kind("auto", device->info());
        const DrawnView full = view_of(*device, scene, raster),
                        view = view_of(*device, scene, raster, alpha_min);
        const oracle::Model model = oracle::to_model(scene.model);
        const oracle::Render all = oracle::render(model, scene.camera, {.background = scene.background});
        const oracle::Render some =
            oracle::render(model, scene.camera, {.background = scene.background, .alpha_min = alpha_min});
        double low = *std::ranges::min_element(scene.background),
               high = *std::ranges::max_element(scene.background);
        for (int row = 0; row < 3; ++row)
          for (const float colour : scene.model.row(scene.model.layout().rgb + row)) {
            low = std::min(low, static_cast<double>(colour));
            high = std::max(high, static_cast<double>(colour));
          }
        double most = 0, share = 0;
        for (std::size_t i = 0; i < view.image.size(); ++i) {
          const std::size_t p = i / 3;
          const double left_out = some.left_out[p] * static_cast<double>(alpha_min);
          const double bound = (high - low) * (left_out + all.closed[p] + some.closed[p]) + 3e-6;
          const double error = std::abs(view.image[i] - full.image[i]);
          most = std::max(most, error);
          share = std::max(share, error / bound);
        }
        INFO(device->info().name << ", alpha_min " << alpha_min << ": largest error " << most
                                 << ", largest share of the bound " << share);
        fmt::print(
            "alpha_min {:.4f}, opacity + {}: largest error {:.2e}, largest share of the bound {:.2f}\n",
            alpha_min, more_opacity, most, share);
        CHECK(share <= 1);
        CHECK(share > 0.1);  // otherwise, the bound would be too loose to test anything
        CHECK(std::ranges::any_of(all.closed, [](double s) { return s > 0; }));
      }
}

TEST_CASE("alpha_min must be 0 or at least 1e-6", "[work]") {
  TrainSettings settings = test::published();
  settings.alpha_min = 0.25;
  validate(settings);
  settings.alpha_min = 1e-9;
  CHECK_THROWS_WITH(validate(settings), Catch::Contains("alpha_min = 1e-09 must be 0 or at least 1e-06"));
}

}  // namespace
}  // namespace ubs
