// SPDX-License-Identifier: Apache-2.0
// UBS_FORWARD_TURNS and UBS_BACKWARD_TURNS, the ways in which CUDA's rasterisers hand tiles to blocks: the
// bits of a block a tile, whatever is drawn, in which order, and with launch graphs.
#include <algorithm>
#include <catch2/catch.hpp>

#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/reference/scenes.hpp"
#include "tests/support/cuda_devices.hpp"

namespace ubs {
namespace {

using test::cuda_devices;
using test::Tuned;

TuningValues turns(unsigned forward, unsigned backward) {
  return {{"UBS_FORWARD_TURNS", forward}, {"UBS_BACKWARD_TURNS", backward}};
}

Camera sized(Camera camera, int width, int height) {
  camera.width = width;
  camera.height = height;
  return camera;
}

// Views of several sizes after one another, on the same stages; the backward passes of two at a time come
// after both have been drawn, so that the order of the tiles is not that of their own lists, or of another
// number.
std::vector<std::vector<float>> drawn(Device& device, const oracle::Scene& scene,
                                      const KernelConfig& config) {
  const auto stages = make_stages(device, config);
  const DeviceModel model(device, scene.model);
  const std::vector<Camera> cameras{scene.camera, sized(scene.camera, 61, 37), sized(scene.camera, 37, 61),
                                    sized(scene.camera, 16, 16)};
  Renderer a(device, *stages), b(device, *stages);
  a.set_cameras(cameras);
  b.set_cameras(cameras);
  Buffer<float> v_params(device, "parameter gradients",
                         static_cast<std::size_t>(model.rows()) * model.stride());
  v_params.zero();
  std::vector<std::vector<float>> results;
  const auto forward = [&](Renderer& renderer, std::size_t view) {
    renderer.forward(model.view(), static_cast<std::uint32_t>(view), {}, config.backward);
    const RenderedView seen = renderer.download();
    results.insert(results.end(), {seen.rgb, seen.alpha, seen.depth});
  };
  const auto backward = [&](Renderer& renderer) {
    device.copy(*renderer.image().memory, 0, *renderer.v_image().memory, 0, 12 * renderer.shape().plane());
    renderer.backward(v_params.view(), false);
    results.push_back(v_params.download());
  };
  for (std::size_t view = 0; view < cameras.size(); ++view) {
    forward(a, view);
    if (config.backward) backward(a);
  }
  forward(a, 1);
  forward(b, 2);
  if (config.backward && !config.splat_backward) backward(a), backward(b);
  forward(b, 3);
  if (config.backward && !config.splat_backward) backward(a);
  return results;
}

struct Choice {
  const char* name;
  void (*set)(KernelConfig&);
};

TEST_CASE("turns of tiles give the bits of a block a tile", "[work]") {
  const Choice choices[] = {
      {"default", [](KernelConfig&) {}},
      {"depth, forward only", [](KernelConfig& c) { c.depth = true, c.backward = false; }},
      {"by splats", [](KernelConfig& c) { c.splat_backward = true; }},
      {"tiles of 8, whole ones",
       [](KernelConfig& c) { c.approximation.tile = 8, c.work.masked_backward = false; }},
  };
  for (const auto& device : cuda_devices())
    for (const Choice& choice : choices)
      for (const oracle::Scene& scene :
           {oracle::regular_scene({.count = 120, .dim = 6, .seed = 3, .width = 45, .height = 37}),
            oracle::opaque_stack_scene({.count = 300, .dim = 6, .seed = 5, .width = 45, .height = 37})}) {
        KernelConfig config{.dim = 6, .raster = RasterKind::gpu};
        choice.set(config);
        const auto expected = drawn(*device, scene, config);
        CHECK(std::ranges::any_of(expected.front(), [](float v) { return v != 0; }));
        for (const unsigned value : {1u, 2u, 3u}) {
          INFO(device->info().name << ", " << choice.name << ", turns " << value);
          const Tuned tuned(*device, turns(value, value));
          const bool same = drawn(*device, scene, config) == expected;
          CHECK(same);
        }
        if (choice.set != choices[0].set) continue;
        for (const auto& [forward, backward] : {std::pair{0u, 3u}, {2u, 0u}, {3u, 2u}}) {
          const Tuned tuned(*device, turns(forward, backward));
          const bool same = drawn(*device, scene, config) == expected;
          CHECK(same);
        }
      }
}

TEST_CASE("turns of tiles without splats, and with atomics", "[work]") {
  for (const auto& device : cuda_devices())
    for (const unsigned value : {0u, 3u}) {
      const Tuned tuned(*device, turns(value, value));
      const auto results = drawn(*device, oracle::empty_scene({.width = 61, .height = 45}),
                                 {.dim = 6, .raster = RasterKind::gpu});
      for (const std::vector<float>& values : results)
        CHECK(std::ranges::all_of(values, [](float v) { return v == 0; }));
      // Their sums have no order; that all tiles are drawn is seen in the images.
      const KernelConfig config{.dim = 6, .raster = RasterKind::gpu, .atomics = true};
      CHECK_NOTHROW(
          drawn(*device, oracle::regular_scene({.count = 50, .dim = 6, .seed = 3, .width = 40, .height = 40}),
                config));
    }
}

// Through growth, and steps that are drawn twice because the lists outgrow their room.
TEST_CASE("training with turns of tiles gives the same bits, with launch graphs too", "[work]") {
  const test::Data data = test::synthetic("glossy", 20, 6);
  for (const auto& device : cuda_devices()) {
    TrainSettings settings = test::short_run(6, 16, 100);
    settings.cap_max = 400;
    settings.growth = 1.5;
    settings.refine_every = 3000;
    settings.list_counts = "bound";
    LaunchGraph::Counts graphs;
    const auto trained = [&] {
      Trainer trainer(*device, settings, data.train, data.test, initialise_random(6, 100, 42, {}));
      trainer.run([](const StepReport&) { return true; });
      graphs = trainer.launch_graphs();
      return trainer.state().model.values;
    };
    const auto expected = trained();
    const Tuned tuned(*device, turns(3, 3));
    CHECK(trained() == expected);
    settings.launch_graph = "true";
    CHECK(trained() == expected);
    CHECK(graphs.launched > 12);
    CHECK(graphs.made < 12);
  }
}

}  // namespace
}  // namespace ubs
