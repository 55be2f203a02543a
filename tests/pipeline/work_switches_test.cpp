// SPDX-License-Identifier: Apache-2.0
// What the kernels leave out (host/device/work_switches.hpp): all switches but alpha_min leave the bits of
// image and gradient as they are and do less; alpha_min agrees with float64 and stays within its stated
// bound.
#include <algorithm>
#include <catch2/catch.hpp>

#include "host/base/error.hpp"
#include "host/bench/blend_count.hpp"
#include "host/bench/capture_stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "host/spec/train_settings.hpp"
#include "tests/pipeline/oracle_comparison.hpp"
#include "tests/reference/oracle.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

constexpr RasterKind kRasters[] = {RasterKind::cpu, RasterKind::gpu};

oracle::Scene scene_of(ModelVariant variant = {}, std::size_t count = 400) {
  oracle::Scene scene = oracle::regular_scene(
      {.count = count, .dim = 6, .seed = 3, .width = 93, .height = 71, .variant = variant});
  if (variant.has_spatial_beta())  // as in variant_test.cpp
    for (float& b : scene.model.row(scene.model.layout().beta)) b = std::max(b, -0.5f);
  return scene;
}

// Opaque layers, so that pixels, blocks and tiles finish.
oracle::Scene opaque_scene() {
  return oracle::opaque_stack_scene({.count = 200, .dim = 6, .seed = 5, .width = 61, .height = 45});
}

struct View {
  std::vector<float> image, alpha, gradient;
  ListTotals totals;
  bench::WorkCounts counts;
};

View view_of(Device& device, const oracle::Scene& scene, RasterKind raster, const WorkSwitches& work) {
  KernelConfig config{.dim = scene.model.dim, .raster = raster, .variant = scene.model.variant};
  config.work = work;
  bench::CaptureStages stages(make_stages(device, config));
  RenderSettings settings;
  for (std::size_t c = 0; c < 3; ++c) settings.background[c] = static_cast<float>(scene.background[c]);
  const std::vector<float> target(scene.target.begin(), scene.target.end());
  View view;
  view.gradient =
      view_gradient(device, stages, scene.model, scene.camera, target, settings, 0.2f).values.values;
  Renderer renderer(device, stages);
  renderer.set_cameras({scene.camera});
  const DeviceModel model(device, scene.model);
  view.totals = renderer.forward(model.view(), 0, settings, true);
  view.counts = bench::count_work(device, config.dim, scene.model.count, view.totals.visible,
                                  view.totals.intersections, stages.last.raster_forward, work.alpha_min);
  const RenderedView rendered = renderer.download();
  view.image = rendered.rgb;
  view.alpha = rendered.alpha;
  return view;
}

// Zeros of either sign are the same: a slot that was not written adds +0, one that was adds what it holds.
void check_same(const View& a, const View& b) {
  CHECK(a.image == b.image);
  CHECK(a.alpha == b.alpha);
  CHECK(a.gradient == b.gradient);
}

TEST_CASE("switches without effect on results leave all bits as they are", "[work]") {
  for (const auto& device : opencl_devices_under_test())
    for (const RasterKind raster : kRasters) {
      INFO(device->info().name << ", raster " << test::text(raster));
      for (const oracle::Scene& scene : {scene_of(), opaque_scene()}) {
        const View view = view_of(*device, scene, raster, {});
        REQUIRE(std::ranges::any_of(view.gradient, [](float v) { return v != 0; }));
        const View all = view_of(*device, scene, raster, {.view_cull = false});
        check_same(view, all);
        CHECK(all.totals.visible == view.totals.visible);
        const View boxes = view_of(*device, scene, raster, {.block_cull = BlockCull::box});
        check_same(view, boxes);
        CHECK(boxes.counts.blocks > view.counts.blocks);
        const View unfinished = view_of(*device, scene, raster, {.skip_finished = false});
        check_same(view, unfinished);
        CHECK(unfinished.counts.blocks >= view.counts.blocks);
        check_same(view, view_of(*device, scene, raster, {.masked_backward = false}));
        check_same(view, view_of(*device, scene, raster, {.extents = Extents::support}));
        check_same(view, view_of(*device, scene, raster,
                                 {.view_cull = false,
                                  .block_cull = BlockCull::box,
                                  .skip_finished = false,
                                  .masked_backward = false}));
      }
      const View view = view_of(*device, opaque_scene(), raster, {});
      const View unfinished = view_of(*device, opaque_scene(), raster, {.skip_finished = false});
      CHECK(unfinished.counts.blocks > view.counts.blocks);
      CHECK(unfinished.counts.blended == view.counts.blended);
    }
}

TEST_CASE("extents by opacity change no bit where a least alpha is given", "[work]") {
  const ModelVariant gaussian{.kernel = SpatialKernel::gaussian};
  for (const auto& device : opencl_devices_under_test())
    for (const RasterKind raster : kRasters)
      for (const auto& [scene, alpha_min] : {std::pair{scene_of(), 1e-6f},
                                             {scene_of(), 1.0f / 255},
                                             {scene_of(), 0.1f},
                                             {opaque_scene(), 0.02f},
                                             {scene_of(gaussian), 0.0f},
                                             {scene_of(gaussian), 0.05f}}) {
        INFO(device->info().name << ", raster " << test::text(raster) << ", "
                                 << to_string(scene.model.variant) << ", alpha_min " << alpha_min);
        const View full =
            view_of(*device, scene, raster, {.alpha_min = alpha_min, .extents = Extents::support});
        const View view = view_of(*device, scene, raster, {.alpha_min = alpha_min});
        check_same(full, view);
        CHECK(view.totals.intersections <= full.totals.intersections);
        if (alpha_min > 1e-3f || scene.model.variant == gaussian) {
          CHECK(view.totals.intersections < full.totals.intersections);
          CHECK(view.counts.blocks < full.counts.blocks);
        }
      }
}

TEST_CASE("alpha_min agrees with float64", "[work][oracle]") {
  for (const auto& device : opencl_devices_under_test())
    for (const RasterKind raster : kRasters)
      for (const ModelVariant& variant : {ModelVariant{}, ModelVariant{.kernel = SpatialKernel::gaussian}}) {
        KernelConfig config{.dim = 6, .raster = raster, .variant = variant};
        config.work.alpha_min = 0.02f;
        const test::Case c{*device, config, ""};
        const oracle::Scene scene = scene_of(variant, 200);
        const std::string name = "alpha_min " + to_string(variant);
        test::compare_forward(c, name, scene, 3.2e-6);
        test::compare_gradient(c, name, scene, 4.8e-6);
      }
}

// A contribution that is left out changes the pixel by T alpha (colour - what lies behind), at most alpha_min
// times the range R of colours and background; n of them by n alpha_min R at most. Removing them lets more
// light through, so that a pixel may be stopped elsewhere: a stop leaves out the light S that was left, at
// most S R, with and without alpha_min. Hence |difference| <= R (n alpha_min + S + S').
TEST_CASE("the error of alpha_min stays within its bound", "[work]") {
  for (const auto& device : opencl_devices_under_test())
    for (const bool opaque : {false, true})
      for (const float alpha_min : {1.0f / 255, 0.02f, 0.1f}) {
        const oracle::Scene scene = opaque ? opaque_scene() : scene_of();
        const RasterKind raster = raster_kind("auto", device->info());
        const View full = view_of(*device, scene, raster, {}),
                   view = view_of(*device, scene, raster, {.alpha_min = alpha_min});
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
          const double bound = (high - low) * (some.left_out[p] * static_cast<double>(alpha_min) +
                                               all.closed[p] + some.closed[p]) +
                               3e-6;
          const double error = std::abs(view.image[i] - full.image[i]);
          most = std::max(most, error);
          share = std::max(share, error / bound);
        }
        INFO(device->info().name << (opaque ? ", opaque" : "") << ", alpha_min " << alpha_min
                                 << ": largest error " << most << ", largest share of the bound " << share);
        CHECK(share <= 1);
        CHECK(share > 0.05);  // a bound that is never approached would test nothing
        CHECK(most > 0);
      }
}

TEST_CASE("settings choose the switches", "[work]") {
  TrainSettings settings;
  CHECK(work_switches(settings) == WorkSwitches{});
  CHECK(to_string(work_switches(settings)) == "default");
  settings.alpha_min = 0.25;
  settings.extents = "support";
  settings.view_cull = settings.skip_finished = settings.masked_backward = "off";
  settings.block_cull = "box";
  CHECK(to_string(work_switches(settings)) ==
        "alpha_min 0.25, extents support, view_cull off, block_cull box, skip_finished off, masked_backward "
        "off");
  validate(settings);
  settings.alpha_min = 1e-9;
  CHECK_THROWS_WITH(validate(settings), Catch::Contains("alpha_min = 1e-09 must be 0 or at least 1e-06"));
}

}  // namespace
}  // namespace ubs
