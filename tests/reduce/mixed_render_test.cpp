// SPDX-License-Identifier: Apache-2.0
// Tests rendering a model whose groups of splats have different dimensions into one image, and the gradients
// of each group.
#include <catch2/catch.hpp>

#include "host/lab/oracle/oracle.hpp"
#include "host/model/replacement.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "tests/reduce/reduce_scene.hpp"
#include "tests/support/compare.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/oracle_scene.hpp"

using namespace ubs;
using namespace ubs::test;

namespace {

// Splits a model into two groups with the splats [0, cut) and [cut, count). Both have the same dimension,
// which a file could not store, but they can be rendered, and the image must be bit-identical to that of the
// whole model.
struct Halves {
  Device& device;
  std::unique_ptr<Stages> stages;
  DeviceModel first, second;
  std::vector<RenderGroup> groups;

  Halves(Device& d, const KernelConfig& config, const SplatModel& model, std::size_t cut)
      : device(d),
        stages(make_stages(d, config)),
        first(d, part(model, 0, cut)),
        second(d, part(model, cut, model.count)),
        groups{{stages.get(), first.view()}, {stages.get(), second.view()}} {}
};

}  // namespace

TEST_CASE("a model that is split into two groups gives the same image and gradient", "[reduce][mixed]") {
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device))
      for (const std::size_t cut : {std::size_t{77}, std::size_t{128}, std::size_t{199}}) {
        DYNAMIC_SECTION(device->info().name << (raster == RasterKind::cpu ? " cpu " : " gpu ") << cut) {
          const oracle::Scene scene =
              oracle::regular_scene({.count = 200, .dim = 6, .seed = 6, .width = 61, .height = 45});
          const KernelConfig config{.dim = 6, .raster = raster};
          Halves halves(*device, config, scene.model, cut);
          const std::vector<float> target = target_of(scene);
          const ViewGradient whole = view_gradient(*device, *halves.stages, scene.model, scene.camera, target,
                                                   settings_of(scene), 0.2f);
          DeviceModel on_device(*device, scene.model);
          Renderer one(*device, *halves.stages), two(*device, *halves.stages);
          for (Renderer* renderer : {&one, &two}) renderer->set_cameras({scene.camera});
          one.forward(on_device.view(), 0, settings_of(scene), false);
          two.forward(halves.groups, 0, settings_of(scene), true);
          const RenderedView a = one.download(), b = two.download();
          CHECK((a.rgb == b.rgb && a.alpha == b.alpha));

          Buffer<float> sums(*device, "sums", 8), pixels(*device, "target", target.size());
          pixels.upload(target);
          halves.stages->image_loss({.shape = two.shape(),
                                     .image = two.image(),
                                     .target = {},
                                     .target_float = pixels.view(),
                                     .weights = loss_weights(0.2f),
                                     .v_image = two.v_image(),
                                     .sums = sums.view()});
          std::vector<Buffer<float>> gradients;
          for (const DeviceModel* model : {&halves.first, &halves.second})
            gradients.emplace_back(*device, "gradient",
                                   static_cast<std::size_t>(model->rows()) * model->stride());
          const std::vector<BufferView<float>> views{gradients[0].view(), gradients[1].view()};
          two.backward(views, false);
          const SplatModel g0 =
              download_rows(gradients[0], halves.first.layout(), halves.first.count(), halves.first.stride());
          const SplatModel g1 = download_rows(gradients[1], halves.second.layout(), halves.second.count(),
                                              halves.second.stride());
          CHECK((g0.values == part(whole.values, 0, cut).values));
          CHECK((g1.values == part(whole.values, cut, 200).values));
          double norm = 0;
          for (const float v : g1.values) norm += std::abs(v);
          CHECK(norm > 0);
        }
      }
}

// Renders a 6-D model in which the direction has no effect on every third splat, after these splats are
// converted to 3-D, and compares image and gradients with those of the original model in float64.
TEST_CASE("converting splats without directional effect to 3-D does not change the image",
          "[reduce][mixed]") {
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device)) {
      DYNAMIC_SECTION(device->info().name << (raster == RasterKind::cpu ? " cpu" : " gpu")) {
        oracle::Scene scene =
            oracle::regular_scene({.count = 200, .dim = 6, .seed = 5, .width = 61, .height = 45});
        const ParameterLayout layout = scene.model.layout();
        // Steep rims would hide errors, see variant_scene() in pipeline/variant_test.cpp.
        for (float& b : scene.model.row(layout.beta)) b = std::max(b, -0.5f);
        std::vector<std::size_t> kept, turned;
        for (std::size_t i = 0; i < scene.model.count; ++i) (i % 3 == 0 ? turned : kept).push_back(i);
        for (const std::size_t i : turned)
          for (int q = 0; q < 3; ++q) scene.model.row(layout.query_beta + q)[i] = -120;
        MixedModel mixed(std::vector<SplatModel>{selection(scene.model, kept), SplatModel(3, turned.size())});
        for (std::size_t i = 0; i < turned.size(); ++i) {
          const auto found = reduce::replacements(scene.model, turned[i], {}, 1);
          REQUIRE(found.size() == 1);
          REQUIRE(found[0].effect.exact);
          for (int r = 0; r < mixed.groups[1].layout().count; ++r)
            mixed.groups[1].row(r)[i] = found[0].values[static_cast<std::size_t>(r)];
        }
        KernelConfig config{.dim = 6, .raster = raster};
        const DeviceGroups groups(*device, mixed, config);
        Renderer renderer(*device, groups.stages());
        renderer.set_cameras({scene.camera});
        renderer.forward(groups.view(), 0, settings_of(scene), false);
        const RenderedView image = renderer.download();
        const oracle::Render expected =
            oracle::render(oracle::to_model(scene.model), scene.camera, {.background = scene.background});
        std::vector<double> interleaved(image.rgb.size());
        const std::size_t pixels = interleaved.size() / 3;
        for (std::size_t c = 0; c < 3; ++c)
          for (std::size_t i = 0; i < pixels; ++i) interleaved[3 * i + c] = expected.image[c * pixels + i];
        CHECK(max_abs_error(image.rgb, interleaved) <= 3.2e-6);  // the same bound as in variant_test.cpp

        // Compares gradients for the parameters that 3-D and 6-D splats have in common.
        const oracle::Gradient reference = oracle::gradient(oracle::to_model(scene.model), scene.camera,
                                                            scene.target, {.background = scene.background});
        const MixedViewGradient gradient =
            view_gradient(*device, config, mixed, scene.camera, target_of(scene), settings_of(scene), 0.2f);
        CHECK(gradient.loss == Approx(reference.loss).epsilon(1e-5));
        const ParameterLayout small(3);
        for (const auto& [now, old, rows] : {std::array{small.xyz, layout.xyz, 3},
                                             {small.rgb, layout.rgb, 3},
                                             {small.opacity, layout.opacity, 1},
                                             {small.beta, layout.beta, 1},
                                             {small.scale, layout.scale, 3},
                                             {small.l_triangle, layout.l_triangle, 3}}) {
          std::vector<float> actual;
          std::vector<double> wanted;
          for (int r = 0; r < rows; ++r)
            for (std::size_t i = 0; i < turned.size(); ++i) {
              actual.push_back(gradient.values.groups[1].row(now + r)[i]);
              wanted.push_back(
                  reference.values[static_cast<std::size_t>(old + r) * scene.model.count + turned[i]]);
            }
          INFO("rows from " << old);
          CHECK(relative_error(actual, wanted) <= 4.8e-6);  // the same bound as in variant_test.cpp
        }
      }
    }
}
