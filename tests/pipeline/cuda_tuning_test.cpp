// SPDX-License-Identifier: Apache-2.0
// Tests `ubs-lab tune` on CUDA devices: every candidate of every tuned constant gives the same results as the
// default, and the chosen values are applied, stored and loaded again.
#include <algorithm>
#include <catch2/catch.hpp>
#include <set>

#include "host/lab/bench/step_bench.hpp"
#include "host/lab/bench/tune_subject.hpp"
#include "host/train/run_settings.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/cuda_devices.hpp"
#include "tests/support/set_variable.hpp"

namespace ubs {
namespace {

using test::cuda_devices;
using test::Tuned;

TEST_CASE("no candidate of a tuned constant of CUDA changes the results of a training step", "[work]") {
  const bench::BenchScene scene = bench::synthetic_object(6, 400, 40, 30, 1);
  const auto outputs = [&](Device& device) {
    return bench::StepBench(device, scene, RasterKind::gpu).outputs();
  };
  for (const auto& device : cuda_devices()) {
    const bench::Parts expected = outputs(*device);
    for (const std::vector<float>& part : expected)  // a part with only zeros would not show a difference
      REQUIRE(std::ranges::any_of(part, [](float v) { return v != 0; }));
    for (const TunedConstant& constant : dynamic_cast<TunableDevice&>(*device).tuned_constants()) {
      CHECK(constant.raster == RasterKind::gpu);
      CHECK(std::ranges::none_of(constant.candidates, [&](unsigned v) { return v == constant.standard; }));
      for (const unsigned value : constant.candidates) {
        INFO(device->info().name << ", " << constant.macro << " = " << value);
        const Tuned tuned(*device, {{std::string(constant.macro), value}});
        CHECK(bench::relative_difference(outputs(*device), expected) == 0);
      }
    }
  }
}

TEST_CASE("tune tries every candidate of the CUDA back end and applies the chosen values", "[work]") {
  const bench::BenchScene scene = bench::synthetic_object(6, 100, 16, 16, 1);
  for (const auto& device : cuda_devices()) {
    const Tuned reset(*device, {});
    std::set<std::pair<std::string, unsigned>> tried;
    const TuningValues values = bench::tune(
        *device, scene, {.raster = RasterKind::gpu, .quick = true, .on_trial = [&](const bench::Trial& t) {
                           INFO(t.macro << " = " << t.value << ": " << t.note);
                           CHECK(t.note.empty());
                           CHECK((t.ms > 0 && t.before_ms > 0));
                           tried.insert({t.macro, t.value});
                         }});
    std::size_t candidates = 0;
    for (const TunedConstant& constant : dynamic_cast<TunableDevice&>(*device).tuned_constants())
      candidates += constant.candidates.size();
    CHECK(tried.size() == candidates);
    CHECK(device->info().tuning == values);
  }
}

TEST_CASE("opening a CUDA device applies the values of its tuning file", "[work]") {
  const test::TempFolder folder;
  const test::Variable place("UBS_TUNING_DIR", folder.path().c_str()), on("UBS_TUNING", nullptr);
  const std::vector<DeviceInfo> devices = list_devices();
  for (std::size_t i = 0; i < devices.size(); ++i) {
    if (devices[i].backend != "cuda") continue;
    const auto first = open_device(i);
    const TunedTable table = dynamic_cast<TunableDevice&>(*first).tuned_constants();
    // A constant of an earlier version, and a value that is not a candidate, are ignored.
    save_tuning(devices[i], table, RasterKind::gpu, {{"UBS_FORWARD_TURNS", 3}, {"UBS_MAP_BLOCK", 32}});
    CHECK(open_device(i)->info().tuning.empty());
    save_tuning(devices[i], table, RasterKind::gpu, {{"UBS_FORWARD_TURNS", 3}, {"UBS_MAP_BLOCK", 64}});
    CHECK(open_device(i)->info().tuning == TuningValues{{"UBS_MAP_BLOCK", 64}});
    save_tuning(devices[i], table, RasterKind::gpu, {});
    CHECK(open_device(i)->info().tuning.empty());
  }
}

}  // namespace
}  // namespace ubs
