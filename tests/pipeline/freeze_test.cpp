// SPDX-License-Identifier: Apache-2.0
// Tests frozen parameter groups (the setting `freeze`): they have no gradients and no moments, training does
// not change their values, and the gradients of the other groups are the same as without `freeze`.
#include <catch2/catch.hpp>
#include <cstring>
#include <map>

#include "host/base/error.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/scene/frozen_groups.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/published.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

using Rows = std::map<int, std::vector<float>>;  // the key is the parameter row

// Returns the gradient of the training loss with respect to the parameter rows that are not frozen. The batch
// contains the same view twice. The loss includes the penalties for opacities and scales.
Rows gradient_rows(Device& device, const oracle::Scene& scene, KernelConfig config, std::uint32_t frozen) {
  config.frozen = frozen;
  const auto stages = make_stages(device, config);
  const ParameterLayout layout = scene.model.layout();
  const DeviceModel model(device, scene.model);
  Renderer renderer(device, *stages);
  renderer.set_cameras({scene.camera});
  const std::vector<float> target(scene.target.begin(), scene.target.end());
  Buffer<float> target_buffer(device, "target", target.size()), sums(device, "sums", 8);
  target_buffer.upload(target);
  Buffer<float> v_params(device, "gradients",
                         static_cast<std::size_t>(trained_rows(layout, frozen)) * model.stride());
  for (const bool accumulate : {false, true}) {
    renderer.forward(model.view(), 0, {}, true);
    stages->image_loss({.shape = renderer.shape(),
                        .image = renderer.image(),
                        .target = {},
                        .target_float = target_buffer.view(),
                        .v_image = renderer.v_image(),
                        .sums = sums.view()});
    renderer.backward(v_params.view(), accumulate);
  }
  stages->regularise(
      {.splats = model.view(), .v_params = v_params.view(), .weights = {.opacity = 0.01f, .scale = 0.01f}});
  Rows rows;
  std::size_t at = 0;
  for (const ParameterGroup& group : parameter_groups(layout))
    for (int row = group.first; row < group.first + group.count; ++row) {
      if (is_frozen(frozen, group.name)) continue;
      rows[row].resize(model.count());
      v_params.download(std::span(rows[row]), at++ * model.stride());
    }
  return rows;
}

TEST_CASE("freezing groups does not change the bits of the other gradients", "[freeze]") {
  const ModelVariant splats3d{
      .rot_mode = RotMode::quaternion, .kernel = SpatialKernel::gaussian, .colour = ColourMode::sh1};
  struct Case {
    int dim;
    ModelVariant variant;
    RasterKind raster;
    std::vector<std::string> freeze;
  };
  const std::vector<Case> cases{
      {4,
       {},
       RasterKind::cpu,
       {"xyz,opacity", "scale,rgb", "xyz,opacity,beta,mean,scale,l_triangle", "xyz,rgb", "rgb,opacity",
        "beta,mean,scale,l_triangle", "xyz,beta,mean,scale,l_triangle"}},
      {4, {}, RasterKind::gpu, {"xyz,opacity,beta,mean,scale,l_triangle"}},
      {3, splats3d, RasterKind::cpu, {"sh_rest", "xyz,scale,rotation"}}};
  for (const auto& device : devices_under_test())
    for (const Case& c : cases) {
      // The CUDA back end on the host takes a long time to compile a program, so the second case is skipped.
      if (on_host(*device) && c.raster == RasterKind::gpu) continue;
      const oracle::Scene scene = oracle::regular_scene(
          {.count = 150, .dim = c.dim, .seed = 9, .width = 61, .height = 45, .variant = c.variant});
      KernelConfig config{.dim = c.dim, .raster = c.raster, .query_grad = c.dim == 3, .variant = c.variant};
      const Rows all = gradient_rows(*device, scene, config, 0);
      for (const std::string& freeze : c.freeze) {
        // Each text of `freeze` needs another program. CUDA on the host tests only the first text, because
        // compiling takes a long time there. Other devices test two texts, or all of them with
        // UBS_TEST_ALL=1.
        const auto number = &freeze - c.freeze.data();
        if (number >= (on_host(*device) ? 1 : test::whole_sweep() ? 9 : 2)) continue;
        const std::uint32_t frozen = frozen_groups(scene.model.layout(), freeze);
        const Rows some = gradient_rows(*device, scene, config, frozen);
        INFO(device->info().name << ", N = " << c.dim << ", raster "
                                 << (c.raster == RasterKind::cpu ? "cpu" : "gpu") << ", freeze " << freeze);
        CHECK(some.size() == static_cast<std::size_t>(trained_rows(scene.model.layout(), frozen)));
        CHECK(some.size() < all.size());
        for (const auto& [row, values] : some) {
          INFO("row " << row);
          CHECK(values == all.at(row));
        }
      }
    }
}

TEST_CASE("training does not change frozen groups", "[freeze][training][opencv]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = test::short_run(3, 40, 200);
    settings.refine.end = settings.refine.first;
    const SplatModel initial = initialise_random(3, 200, settings.seed);
    const auto peak = [&](const std::string& label) { return device->peak_by_label().at(label); };
    const auto run = [&](const std::string& freeze) {
      settings.freeze = freeze;
      device->reset_peak();
      Trainer trainer(*device, settle(settings), data.train, data.test, initial);
      trainer.run([](const StepReport&) { return true; });
      CHECK(trainer.memory_plan().each(MemoryUnit::splat) > 0);
      return std::pair{trainer.model(), peak("first moments")};
    };
    const auto [free, all_bytes] = run("");
    const auto [model, bytes] = run("xyz,rgb");
    CHECK(all_bytes == 14 * row_stride(200) * sizeof(float));
    CHECK(bytes == (14 - 6) * row_stride(200) * sizeof(float));
    CHECK(peak("second moments") == bytes);
    CHECK(peak("parameter gradients") == bytes);
    for (const ParameterGroup& group : parameter_groups(model.layout()))
      for (int row = group.first; row < group.first + group.count; ++row) {
        const bool same =
            std::memcmp(model.row(row).data(), initial.row(row).data(), 200 * sizeof(float)) == 0;
        INFO(group.name);
        CHECK(same == (group.name == "xyz" || group.name == "rgb"));
        CHECK(std::memcmp(free.row(row).data(), initial.row(row).data(), 200 * sizeof(float)) != 0);
      }
  }
}

// Colours may be frozen although refinement adds splats, because refinement copies colours without changing
// them.
TEST_CASE("frozen colours are copied by relocation and growth", "[freeze][training][opencv]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = test::short_run(3, 100, 200);
    settings.cap_max = 260;
    settings.growth = 1.1;
    settings.freeze = "rgb";
    SplatModel initial = initialise_random(3, 200, settings.seed);
    for (int c = 0; c < 3; ++c)
      for (std::size_t i = 0; i < initial.count; ++i) initial.row(3 + c)[i] = 0.25f * static_cast<float>(c);
    Trainer trainer(*device, settle(settings), data.train, data.test, initial);
    trainer.run([](const StepReport&) { return true; });
    const SplatModel model = trainer.model();
    CHECK(model.count == 260);
    for (int c = 0; c < 3; ++c)
      for (const float v : model.row(3 + c)) CHECK(v == 0.25f * static_cast<float>(c));
  }
}

TEST_CASE("groups that cannot be frozen are rejected", "[freeze]") {
  TrainSettings settings = test::published();
  const auto message = [&](const std::string& freeze) {
    settings.freeze = freeze;
    return test::message_of([&] { validate(settings); }, ErrorKind::usage);
  };
  CHECK(message("colour") ==
        "freeze = 'colour': 'colour' is not a parameter group of this model (xyz, rgb, opacity, beta, "
        "mean, scale, l_triangle)");
  CHECK(message("rgb,rgb") == "freeze = 'rgb,rgb': 'rgb' is given twice");
  CHECK(message("rgb,") ==
        "freeze = 'rgb,': '' is not a parameter group of this model (xyz, rgb, opacity, beta, mean, "
        "scale, l_triangle)");
  CHECK(message("xyz") ==
        "freeze = 'xyz': relocation and growth would change xyz: disable them with refine = 0:0:1");
  CHECK(message("opacity") != "");
  CHECK(message("rgb,scale") == "");
  settings.refine.end = settings.refine.first;
  CHECK(message("xyz") == "");
  CHECK(message("xyz,rgb,opacity,beta,mean,scale,l_triangle") ==
        "freeze = 'xyz,rgb,opacity,beta,mean,scale,l_triangle': no parameter would be trained");
}

}  // namespace
}  // namespace ubs
