// SPDX-License-Identifier: Apache-2.0
// The training guard: values that are not finite, put into parameters and moments between steps or made by
// extreme splats, are noticed, named, and answered as settings.on_nan says; without them it changes nothing.
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "host/pipeline/view_gradient.hpp"
#include "host/train/stage_inspector.hpp"
#include "kernels/layout.h"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/lenient_kernels.hpp"

namespace ubs {
namespace {

using test::Data;
using test::kNone;
using test::message_of;
using test::short_run;
using test::start;
using test::synthetic;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
constexpr int kIterations = 60;

TrainSettings guarded(OnNan on_nan) {
  TrainSettings settings = short_run(6, kIterations, 300);
  settings.cap_max = 330;
  settings.refine.step = 1000;  // that is: every second iteration
  settings.on_nan = on_nan;
  return settings;
}

// Writes a value into row `row` of splat `splat`, where the trainer has it.
void poison(Device& device, Trainer& trainer, int row, std::uint32_t splat, float value) {
  const SplatView view = trainer.device_model().view();
  const std::size_t at = static_cast<std::size_t>(row) * view.stride + splat;
  device.write(*view.params.memory, at * sizeof(float), std::as_bytes(std::span(&value, 1)));
}

struct Run {
  std::vector<NonFiniteEvent> events;
  std::string message;  // of the error that ended it
  TrainState end;
};

// Runs to the end; `meddle` is called after each iteration.
template <typename Meddle>
Run run(Trainer& trainer, const Meddle& meddle) {
  Run result;
  trainer.on_nonfinite([&](const NonFiniteEvent& event) { result.events.push_back(event); });
  result.message = message_of(
      [&] {
        trainer.run([&](const StepReport& report) {
          meddle(report.iteration);
          return true;
        });
      },
      ErrorKind::numerical);
  result.end = trainer.state();
  return result;
}

TEST_CASE("guard: without anything to find the results are the same bits", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  for (const auto& device : devices_under_test())
    for (const std::string& raster : raster_names_of(*device)) {
      TrainSettings off = guarded(OnNan::off), on = guarded(OnNan::stop);
      off.raster = on.raster = raster;
      Trainer plain(*device, off, data.train, kNone, start(off)),
          watched(*device, on, data.train, kNone, start(on));
      const auto nothing = [](int) {};
      const TrainState a = run(plain, nothing).end, b = run(watched, nothing).end;
      CHECK(a.adam_steps == b.adam_steps);
      for (const auto& [x, y] :
           {std::pair{&a.model.values, &b.model.values}, {&a.moment1, &b.moment1}, {&a.moment2, &b.moment2}})
        CHECK((x->size() == y->size() && std::memcmp(x->data(), y->data(), x->size() * sizeof(float)) == 0));
    }
}

TEST_CASE("guard: stop names splat, parameter, iteration and stage", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  struct Row {
    int row;
    float value;
    const char* name;
  };
  for (const auto& device : devices_under_test())
    for (const Row& row : {Row{1, kNan, "y"}, Row{3, kInf, "red"}, Row{6, -kInf, "opacity"},
                           Row{14, kNan, "scale_0"}, Row{34, kNan, "l_triangle_14"}}) {
      DYNAMIC_SECTION(device->info().name << ", " << row.name << " = " << row.value) {
        const TrainSettings settings = guarded(OnNan::stop);
        Trainer trainer(*device, settings, data.train, kNone, start(settings));
        const Run result = run(trainer, [&](int iteration) {
          if (iteration == 20) poison(*device, trainer, row.row, 123, row.value);
        });
        REQUIRE(result.events.size() == 1);
        const NonFiniteEvent& event = result.events[0];
        CHECK(event.splat == 123);
        CHECK(event.parameter == row.name);
        CHECK(event.iteration == 21);
        CHECK(event.stage == "parameters");
        CHECK(event.raw.size() == 35);
        CHECK_FALSE(std::isfinite(event.raw[static_cast<std::size_t>(row.row)]));
        CHECK(event.replaced >= 1);
        CHECK_FALSE(trainer.state_is_whole());
        CHECK(result.message.find("splat 123, parameter " + event.parameter) != std::string::npos);
        CHECK(trainer.iteration() == event.iteration);
      }
    }
}

// Finite parameters whose gradient is not, with LenientKernels: colours of 1e38, whose squares SSIM takes.
void make_glaring(Device& device, Trainer& trainer, const Camera& camera, std::uint32_t splat) {
  const std::array<double, 3> centre = camera.centre();
  for (int c = 0; c < 3; ++c)
    poison(device, trainer, c, splat, static_cast<float>(0.5 * centre[static_cast<std::size_t>(c)]));
  for (int c = 3; c < 6; ++c) poison(device, trainer, c, splat, 1e38f);
  poison(device, trainer, 6, splat, 10.0f);
  for (int r = 8; r < 11; ++r) poison(device, trainer, r, splat, -8.0f);  // seen from every direction
  for (int r = 14; r < 17; ++r) poison(device, trainer, r, splat, -1.0f);
}

TEST_CASE("guard: a gradient that is not finite is traced to its stage and view", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  const test::LenientKernels kernels;
  {
    const std::unique_ptr<Device> device = open_device("opencl");
    const TrainSettings settings = guarded(OnNan::stop);
    Trainer trainer(*device, settings, data.train, kNone, start(settings));
    const Run result = run(trainer, [&](int iteration) {
      if (iteration == 25) make_glaring(*device, trainer, data.train.views[0].camera, 7);
    });
    REQUIRE(result.events.size() == 1);
    const NonFiniteEvent& event = result.events[0];
    INFO(summary(event));
    CHECK((event.stage == "image_loss" || event.stage == "raster_forward"));
    CHECK(event.view >= 0);
    CHECK(event.view_name == data.train.views[static_cast<std::size_t>(event.view)].name);
    ViewOrder order(settings.seed, 6);
    CHECK(order(static_cast<std::uint64_t>(event.iteration) - 1) == static_cast<std::uint32_t>(event.view));
    // The reproducer: the model before the step, in the same view.
    REQUIRE(event.replaced == 0);
    CHECK(event.model.row(3)[7] == Approx(1e38f));
    Trainer again(*device, settings, data.train, kNone, event.model);
    std::vector<NonFiniteEvent> events;
    again.on_nonfinite([&](const NonFiniteEvent& e) { events.push_back(e); });
    CHECK_FALSE(
        message_of([&] { again.run([](const StepReport&) { return true; }); }, ErrorKind::numerical).empty());
    CHECK(events.size() == 1);
  }
}

// Spoils one value of the records: as a projection left them, or before the backward rasteriser.
class Spoiler final : public Stages {
 public:
  Spoiler(Device& device, Stages& stages, std::size_t operation, std::size_t at, float value)
      : device_(device), stages_(stages), operation_(operation), at_(sizeof(float) * at), value_(value) {}
  const KernelConfig& config() const override { return stages_.config(); }
  Outcome run(const Operation& operation) override {
    const auto spoil = [&](const BufferView<float>& records) {
      if (operation.index() == operation_ && at_ < sizeof(float) * records.size)
        device_.write(*records.memory, at_, std::as_bytes(std::span(&value_, 1)));
    };
    if (const auto* a = std::get_if<RasterBackward>(&operation)) spoil(a->records);
    Outcome outcome = stages_.run(operation);
    if (const auto* a = std::get_if<ProjectForward>(&operation)) spoil(a->records);
    return outcome;
  }

 private:
  Device& device_;
  Stages& stages_;
  std::size_t operation_, at_;
  float value_;
};

TEST_CASE("guard: the splat where a value began is named, on each rasteriser", "[guard]") {
  const Data data = synthetic("glossy", 32, 2);
  const Camera& camera = data.train.views[0].camera;
  const SplatModel model = initialise_random(6, 300, 3);
  const std::vector<float> target(3 * 32 * 32, 0.25f);
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device)) {
      DYNAMIC_SECTION(device->info().name << ", raster " << (raster == RasterKind::cpu ? "cpu" : "gpu")) {
        const auto stages = make_stages(*device, {.dim = 6, .raster = raster});
        const auto gradient = [&](Stages& through) {
          return view_gradient(*device, through, model, camera, target, {}, 0.2f).values;
        };
        const auto inspected = [&](std::size_t operation, std::size_t value, float spoilt,
                                   std::ptrdiff_t least) {
          Spoiler spoiler(*device, *stages, operation, value, spoilt);
          StageInspector inspector(*device, spoiler);
          const SplatModel v = gradient(inspector);
          const auto opacities = v.row(v.layout().opacity);
          CHECK(std::ranges::count_if(opacities, [](float x) { return !std::isfinite(x); }) >= least);
          REQUIRE(inspector.finding());
          return *inspector.finding();
        };
        // Those that the image shows most.
        const SplatModel whole = gradient(*stages);
        const auto shown = whole.row(whole.layout().opacity);
        std::vector<std::size_t> order(model.count);
        std::iota(order.begin(), order.end(), 0);
        std::ranges::sort(order, {}, [&](std::size_t i) { return -std::abs(shown[i]); });
        order.resize(10);
        for (const std::size_t splat : order) {
          REQUIRE(shown[splat] != 0);
          const StageFinding backward =
              inspected(operation_index<RasterBackward>(), splat * kSplatStride + kSplatR, kInf, 2);
          CHECK(backward.stage == "raster_backward");
          CHECK(backward.splat == static_cast<std::int64_t>(splat));
          const StageFinding forward =
              inspected(operation_index<ProjectForward>(), splat * kSplatStride + kSplatOpacity, kNan, 0);
          CHECK(forward.stage == "project_forward");
          CHECK(forward.where == "opacity of its record");
          CHECK(forward.splat == static_cast<std::int64_t>(splat));
        }

        // Of two groups the second has its records behind those of the first.
        const std::size_t row = model.count + order[0];
        Spoiler spoiler(*device, *stages, operation_index<ProjectForward>(),
                        row * kSplatStride + kSplatOpacity, kNan);
        StageInspector inspector(*device, spoiler);
        const DeviceModel first(*device, model), second(*device, model);
        Renderer renderer(*device, inspector);
        renderer.set_cameras({camera});
        renderer.forward(std::vector<RenderGroup>{{&inspector, first.view()}, {&inspector, second.view()}}, 0,
                         {}, false);
        REQUIRE(inspector.finding());
        CHECK(inspector.finding()->where == "opacity of its record");
        CHECK(inspector.finding()->splat == static_cast<std::int64_t>(row));
      }
    }
}

TEST_CASE("guard: drop makes the splat dead and goes on to a finite model", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = guarded(OnNan::drop);
    settings.appearance = Appearance::gain;
    Trainer trainer(*device, settings, data.train, kNone, start(settings));
    const Run result = run(trainer, [&](int iteration) {
      if (iteration == 20) poison(*device, trainer, 2, 50, kNan);
      if (iteration == 40) poison(*device, trainer, 14, 51, kInf);
    });
    INFO(result.message);
    CHECK(result.message.empty());
    CHECK(result.events.size() == 2);
    CHECK(result.end.dropped == 2);
    CHECK(result.end.iteration == kIterations);
    CHECK(is_finite(result.end));

    // More than can be an accident.
    Trainer worse(*device, settings, data.train, kNone, start(settings));
    const Run stopped = run(worse, [&](int iteration) {
      if (iteration == 20)
        for (std::uint32_t i = 0; i < 11; ++i) poison(*device, worse, 0, i, kNan);
    });
    CHECK(stopped.message.find("11 splats would have been dropped, more than 10") != std::string::npos);
  }
}

// Otherwise a run that goes back a few iterations refines them twice.
TEST_CASE("guard: cameras are refined when what came before is known to be finite", "[guard]") {
  const Data data = synthetic("glossy", 64, 4);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = short_run(6, kIterations, 300);
    settings.refine.end = settings.refine.first;
    settings.refine_cameras = RefineCameras::pose;
    settings.on_nan = OnNan::drop;
    settings.log_every = kIterations;
    const Schedule schedule(settings, 300);
    REQUIRE((schedule.camera_sweep(16) && !schedule.camera_sweep(17) && schedule.camera_sweep(19)));
    Trainer trainer(*device, settings, data.train, kNone, start(settings));
    std::vector<double> before, found;
    trainer.on_nonfinite([&](const NonFiniteEvent& event) {
      CHECK(event.iteration == 17);
      found = trainer.state().cameras;
    });
    trainer.run([&](const StepReport& report) {
      if (report.iteration != 16) return true;
      TrainState state = trainer.state();
      before = state.cameras;
      state.moment2[50] = kInf;
      trainer.restore(state);
      return true;
    });
    CHECK_FALSE(before.empty());
    CHECK(found == before);
    CHECK(trainer.state().dropped == 1);
  }
}

TEST_CASE("guard: rollback goes on from the last state, leaves the view out once, and gives up in the end",
          "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  const test::LenientKernels kernels;
  {
    const std::unique_ptr<Device> device = open_device("opencl");
    TrainSettings settings = guarded(OnNan::rollback);
    settings.appearance = Appearance::affine;
    Trainer trainer(*device, settings, data.train, kNone, start(settings));
    int states = 0;
    trainer.on_state({16, 0, [&](const TrainState&) { ++states; }});
    bool once = false;
    const Run result = run(trainer, [&](int iteration) {
      if (iteration == 25 && !std::exchange(once, true))
        make_glaring(*device, trainer, data.train.views[0].camera, 7);
    });
    INFO(result.message);
    CHECK(result.message.empty());
    REQUIRE(result.events.size() == 1);
    CHECK(result.events[0].action.find("back to iteration 16") != std::string::npos);
    CHECK(result.end.iteration == kIterations);
    CHECK(result.end.rollbacks == 1);
    CHECK(result.end.skipped_draws ==
          std::set<std::uint64_t>{static_cast<std::uint64_t>(result.events[0].iteration) - 1});
    CHECK(is_finite(result.end));
    CHECK(states >= 3);

    Trainer again(*device, settings, data.train, kNone, start(settings));  // poisoned whenever it comes by
    const Run stopped = run(again, [&](int iteration) {
      if (iteration == 25) poison(*device, again, 0, 3, kNan);
    });
    CHECK(stopped.events.size() == static_cast<std::size_t>(kMaxRollbacks) + 1);
    CHECK(stopped.message.find("stopped after 3 rollbacks") != std::string::npos);
  }
}

TEST_CASE("guard: moments that overflow are found, and a batch as well", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = guarded(OnNan::stop);
    settings.batch = 3;
    Trainer trainer(*device, settings, data.train, kNone, start(settings));
    const Run result = run(trainer, [&](int iteration) {
      if (iteration != 10) return;
      TrainState state = trainer.state();
      state.moment2[17 * state.model.count + 200] = kInf;
      trainer.restore(state);
    });
    REQUIRE(result.events.size() == 1);
    CHECK(result.events[0].splat == 200);
    CHECK(result.events[0].iteration == 11);
    CHECK(result.events[0].stage == "adam");
    CHECK(result.events[0].gradient.size() == 35);
    CHECK(result.events[0].view == -1);  // which of the three is not known: none is blamed
    CHECK(result.events[0].view_name.empty());
  }
}

}  // namespace
}  // namespace ubs
