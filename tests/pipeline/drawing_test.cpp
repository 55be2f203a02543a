// SPDX-License-Identifier: Apache-2.0
// Drawing alone: GPUs are given all of a view before the host asks how long its lists are; results are those
// of a renderer that waits, also where the lists had no room.
#include <catch2/catch.hpp>

#include "host/bench/bench_scene.hpp"
#include "host/bench/capture_stages.hpp"
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
  bool waited() const { return stages_.last<CountLists>().totals.size == 0; }

 private:
  bench::CaptureStages stages_;
  Renderer renderer_;
};

TEST_CASE("GPUs are given a view to draw before it is counted", "[renderer]") {
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
      CHECK(drawing.waited());  // there is no room to begin with
      CHECK(drawing.draw(small) == first);
      CHECK(drawing.waited() == !gpu);
      CHECK(drawing.draw(large) == expected);
      CHECK(drawing.waited());  // there was not enough
      CHECK(drawing.draw(small) == first);
      CHECK(drawing.draw(large) == expected);
      CHECK(drawing.waited() == !gpu);
    }
}

}  // namespace
}  // namespace ubs
