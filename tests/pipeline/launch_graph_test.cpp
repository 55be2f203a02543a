// SPDX-License-Identifier: Apache-2.0
// Training with settings.launch_graph: the bits of training without, whatever changes from step to step.
#include <catch2/catch.hpp>

#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

struct Run {
  TrainState state;
  IntersectionCount intersections;
  LaunchGraph::Counts graphs;
};

Run run(Device& device, const TrainSettings& settings, const test::Data& data) {
  Trainer trainer(device, settings, data.train, data.test, initialise_random(6, 100, 42, {}));
  trainer.run([](const StepReport&) { return true; });
  return {trainer.state(), trainer.intersections(), trainer.launch_graphs()};
}

// Splats multiply by four, so that buffers are made anew in the middle of what is recorded; evaluations draw
// other views with the same buffers in between, and now and then a step is drawn twice or its stages are
// timed.
TEST_CASE("launch graphs give the bits of single launches", "[work]") {
  const test::Data data = test::synthetic("glossy", 20, 6);
  for (const auto& device : devices_under_test())
    for (const char* counts : {"bound", "wait"})
      for (const int batch : {1, 2}) {
        DYNAMIC_SECTION(device->info().name << ", list_counts " << counts << ", batch " << batch) {
          TrainSettings settings = test::short_run(6, 40, 100);
          settings.cap_max = 400;
          settings.growth = 1.5;
          settings.refine_every = 3000;
          settings.batch = batch;
          settings.eval_every = 18;
          settings.log_every = 10;
          settings.list_counts = counts;
          const Run expected = run(*device, settings, data);
          CHECK(expected.graphs.given == 0);
          settings.launch_graph = "true";
          if (device->info().backend != "cuda") {
            CHECK_THROWS_WITH(run(*device, settings, data),
                              Catch::Contains("launch_graph is written for CUDA"));
            continue;
          }
          const Run found = run(*device, settings, data);
          CHECK(expected.state.model.count == 400);
          CHECK(found.state.model.values == expected.state.model.values);
          CHECK(found.state.moment1 == expected.state.moment1);
          CHECK(found.state.moment2 == expected.state.moment2);
          CHECK(found.state.loss_sums == expected.state.loss_sums);
          CHECK(found.intersections.total == expected.intersections.total);
          CHECK(found.intersections.repeated == expected.intersections.repeated);
          const bool bound = settings.list_counts == "bound";
          CHECK((expected.intersections.repeated > 0) == bound);
          // Forward, where it does not wait, and backward; without the first ones and those of the timed
          // iteration.
          const auto steps = static_cast<std::uint64_t>(40 * batch);
          CHECK(found.graphs.launched > (bound ? 2 : 1) * steps * 3 / 4);
          CHECK(found.graphs.made >= (bound ? 2u : 1u));
          CHECK(found.graphs.made < 12);
        }
      }
}

}  // namespace
}  // namespace ubs
