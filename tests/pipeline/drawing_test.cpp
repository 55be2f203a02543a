// SPDX-License-Identifier: Apache-2.0
// Tests rendering without gradients. On a GPU, the renderer submits all work of a view before the host knows
// the sizes of the lists of intersections, using buffers with the capacity that earlier views needed. The
// results must equal those of a renderer that waits for the sizes, even if the capacity turns out to be too
// small.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "host/lab/bench/bench_scene.hpp"
#include "host/pipeline/capture_stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

struct Drawn {
  ListTotals totals;
  std::vector<float> rgb;
  bool operator==(const Drawn& other) const {
    return totals.visible == other.totals.visible && totals.intersections == other.totals.intersections &&
           rgb == other.rgb;
  }
};

class Drawing {
 public:
  Drawing(Device& device, const KernelConfig& config, const Camera& camera)
      : stages_(make_stages(device, config)), renderer_(device, stages_) {
    renderer_.set_cameras({camera});
  }
  Drawn draw(const DeviceModel& model) {
    const ListTotals totals = renderer_.forward(model.view(), 0, {}, false);
    return {totals, renderer_.download().rgb};
  }
  // Returns whether the last view waited for the sizes of its lists.
  bool waited() const { return stages_.last<CountLists>().totals.size == 0; }

 private:
  CaptureStages stages_;
  Renderer renderer_;
};

TEST_CASE("the work of a view is submitted to GPUs before its lists are counted", "[renderer]") {
  const bench::BenchScene few = bench::random_start(3, 300, 64, 64),
                          many = bench::random_start(3, 3000, 64, 64);
  const Camera camera = few.views.views[0].camera;
  for (const auto& device : devices_under_test())
    for (const bool backward : {false, true}) {
      KernelConfig config{.dim = 3, .raster = RasterKind::gpu};
      config.backward = backward;
      INFO(describe(device->info()) << (backward ? ", with backward" : ""));
      const bool gpu = device->info().type != DeviceType::cpu;
      const DeviceModel small(*device, few.model), large(*device, many.model);
      Drawing fresh(*device, config, camera), drawing(*device, config, camera);
      const Drawn expected = fresh.draw(large);
      REQUIRE(expected.totals.intersections > 0);
      const Drawn first = drawing.draw(small);
      CHECK(drawing.waited());  // the capacity is unknown before the first view
      CHECK(drawing.draw(small) == first);
      CHECK(drawing.waited() == !gpu);
      CHECK(drawing.draw(large) == expected);
      CHECK(drawing.waited());  // the capacity was not sufficient
      CHECK(drawing.draw(small) == first);
      CHECK(drawing.draw(large) == expected);
      CHECK(drawing.waited() == !gpu);
    }
}

TEST_CASE("with the GPU rasteriser, a view without gradients needs no slots, masks or states", "[renderer]") {
  const bench::BenchScene scene = bench::random_start(3, 3000, 64, 64);
  for (const auto& device : devices_under_test()) {
    INFO(describe(device->info()));
    CaptureStages stages(make_stages(*device, {.dim = 3, .raster = RasterKind::gpu}));
    const DeviceModel model(*device, scene.model);
    Renderer renderer(*device, stages);
    renderer.set_cameras({scene.views.views[0].camera});
    const auto written = [&] {
      const auto lists = stages.last<BuildLists>();
      const auto raster = stages.last<RasterForward>();
      return std::array{lists.sorted_slots.size > 0, raster.sorted_slots.size > 0, raster.masks.size > 0,
                        raster.states.size > 0};
    };
    constexpr std::array kAll{true, true, true, true}, kNone{false, false, false, false};
    renderer.forward(model.view(), 0, {}, true);
    const std::vector<float> expected = renderer.download().rgb;
    CHECK(written() == kAll);
    renderer.forward(model.view(), 0, {}, false);
    CHECK(written() == kNone);
    CHECK(renderer.download().rgb == expected);
    CHECK_THROWS_WITH(renderer.backward_to_records(), Catch::Contains("for_backward"));
    renderer.keep_lists();
    renderer.forward(model.view(), 0, {}, false);
    CHECK(written() == kAll);
    CHECK(renderer.download().rgb == expected);
  }
}

TEST_CASE("the capacity of lists that the host does not count is slightly larger than recent views needed",
          "[renderer]") {
  const bench::BenchScene few = bench::random_start(3, 300, 64, 64),
                          many = bench::random_start(3, 3000, 64, 64);
  for (const auto& device : devices_under_test()) {
    INFO(describe(device->info()));
    CaptureStages stages(make_stages(*device, {.dim = 3}));
    const DeviceModel small(*device, few.model), large(*device, many.model);
    Renderer renderer(*device, stages);
    renderer.set_cameras({few.views.views[0].camera});
    const auto room_after = [&](const DeviceModel& model) {
      DeferredView view = renderer.forward_deferred(model.view(), 0, {});
      CHECK(view.had_capacity());
      return stages.last<CountLists>().room.intersections;
    };
    const std::uint64_t most = renderer.forward(large.view(), 0, {}, true).intersections;
    const std::vector<float> expected = renderer.download().rgb;
    CHECK(room_after(large) <= most + most / 4);
    CHECK(room_after(small) <= most + most / 4);  // the first view is still recent
    CHECK(room_after(small) >= most);
    for (int k = 0; k < 300; ++k) room_after(small);
    CHECK(room_after(small) < most);
    CHECK_FALSE(renderer.forward_deferred(large.view(), 0, {}).had_capacity());
    CHECK(renderer.forward(large.view(), 0, {}, true).intersections == most);
    CHECK(renderer.download().rgb == expected);
    CHECK(room_after(large) >= most);
  }
}

// Renders a camera that sees few splats, each of which intersects many tiles, and then a camera that sees
// many splats with fewer intersections in total.
TEST_CASE("a view with many more visible splats than recent views is rendered again, even if its lists fit",
          "[renderer]") {
  const bench::BenchScene scene = bench::random_start(3, 3000, 64, 64);
  const Camera wide = scene.views.views[0].camera;
  Camera zoomed = wide;  // four times the pixels in each direction, and a quarter of the field of view
  zoomed.width *= 4, zoomed.height *= 4;
  zoomed.cx *= 4, zoomed.cy *= 4;
  zoomed.fx *= 16, zoomed.fy *= 16;
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device)) {
      INFO(describe(device->info()) << (raster == RasterKind::cpu ? ", cpu kernels" : ", gpu kernels"));
      CaptureStages stages(make_stages(*device, {.dim = 3, .raster = raster}));
      const DeviceModel model(*device, scene.model);
      // Returns the image of the last view and the gradient for v_image = 1.
      const auto result = [&](Renderer& renderer) {
        const std::vector<float> v_image(3 * renderer.shape().plane(), 1.0f);
        device->write(*renderer.v_image().memory, 0, std::as_bytes(std::span(v_image)));
        Buffer<float> v_params(*device, "gradients", std::size_t{model.stride()} * model.rows());
        v_params.zero();
        renderer.backward(v_params.view(), false);
        return std::pair(renderer.download().rgb, v_params.download());
      };
      Renderer renderer(*device, stages), fresh(*device, stages);
      for (Renderer* each : {&renderer, &fresh}) each->set_cameras({zoomed, wide});
      const ListTotals many = fresh.forward(model.view(), 1, {}, true);
      const auto expected = result(fresh);
      REQUIRE(std::ranges::any_of(expected.second, [](float value) { return value != 0; }));

      const ListTotals few = renderer.forward(model.view(), 0, {}, true);
      const auto of_few = result(renderer);
      REQUIRE(few.visible + few.visible / 4 < many.visible);
      REQUIRE(few.intersections >= many.intersections);
      CHECK(renderer.forward_deferred(model.view(), 0, {}).had_capacity());
      CHECK(stages.last<CountLists>().room.visible == few.visible + few.visible / 4);
      CHECK(result(renderer) == of_few);

      DeferredView view = renderer.forward_deferred(model.view(), 1, {});
      CHECK(stages.last<CountLists>().room.intersections >= many.intersections);
      CHECK_FALSE(view.had_capacity());
      CHECK(view.totals().visible == many.visible);
      CHECK(view.totals().intersections == many.intersections);
      CHECK(std::ranges::all_of(renderer.download().rgb, [](float value) { return value == 0; }));
      renderer.forward(model.view(), 1, {}, true);
      CHECK(result(renderer) == expected);
      CHECK(renderer.forward_deferred(model.view(), 1, {}).had_capacity());
      CHECK(result(renderer) == expected);
    }
}

// Tests image sizes and target addresses with different alignments.
TEST_CASE("downloaded images contain the values of the planes on the device, pixel by pixel", "[renderer]") {
  for (const auto& device : devices_under_test())
    for (const auto& [width, height] : {std::pair{1, 1}, {3, 2}, {61, 45}, {160, 3}}) {
      bench::BenchScene scene = bench::random_start(3, 300, width, height);
      const KernelConfig config{.dim = 3, .depth = true};
      const std::unique_ptr<Stages> stages = make_stages(*device, config);
      const DeviceModel model(*device, scene.model);
      Renderer renderer(*device, *stages);
      renderer.set_cameras({scene.views.views[0].camera});
      renderer.forward(model.view(), 0, {}, false);
      const ImageShape shape = renderer.shape();
      std::vector<float> planes(3 * shape.plane());
      device->read(*renderer.image().memory, 0, std::as_writable_bytes(std::span(planes)));
      const std::size_t values = 3 * static_cast<std::size_t>(width * height);
      for (std::size_t first = 0; first < 5; ++first) {
        INFO(describe(device->info()) << ", " << width << "x" << height << ", from " << first);
        std::vector<float> room(first + values + 5, -7.0f), expected = room;
        std::vector<std::byte> staging;
        renderer.download({.rgb = std::span(room).subspan(first, values)}, staging);
        for (std::size_t i = 0; i < values; ++i) {
          const std::size_t pixel = i / 3, w = static_cast<std::size_t>(width);
          expected[first + i] =
              planes[i % 3 * shape.plane() + pixel / w * static_cast<std::size_t>(shape.pitch()) + pixel % w];
        }
        CHECK(room == expected);
        CHECK(std::set(expected.begin(), expected.end()).size() > 1);
      }
    }
}

}  // namespace
}  // namespace ubs
