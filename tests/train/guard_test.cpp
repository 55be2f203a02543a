// SPDX-License-Identifier: Apache-2.0
// Tests the training guard. Values that are not finite are written into parameters and moments between steps,
// or are caused by extreme splats. The guard must detect and report them, and react according to
// settings.on_nan. If all values are finite, it must not change the results.
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <limits>

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
  // The interval refers to a run of 30 000 iterations. In this run of 60 iterations, every second iteration
  // refines.
  settings.refine.step = 1000;
  settings.on_nan = on_nan;
  return settings;
}

// Writes a value into row `row` of splat `splat` in the memory of the trainer.
void poison(Device& device, Trainer& trainer, int row, std::uint32_t splat, float value) {
  const SplatView view = trainer.scene().device_model().view();
  const std::size_t at = static_cast<std::size_t>(row) * view.stride + splat;
  device.write(*view.params.memory, at * sizeof(float), std::as_bytes(std::span(&value, 1)));
}

struct Run {
  std::vector<std::string> warnings;  // warnings after which training continued
  std::string message;                // message of the error that ended training
  TrainState end;
};

// Trains to the end, and calls `meddle` after each iteration.
template <typename Meddle>
Run run(Trainer& trainer, const Meddle& meddle) {
  Run result;
  trainer.on_nonfinite([&](const std::string& message) { result.warnings.push_back(message); });
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

TEST_CASE("guard: if all values are finite, results are bit-identical with and without it", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  for (const auto& device : devices_under_test())
    for (const std::string& raster : raster_names_of(*device)) {
      TrainSettings off = guarded(OnNan::off), on = guarded(OnNan::stop);
      off.raster = on.raster = raster;
      Trainer plain(*device, settle(off), data.train, kNone, start(off)),
          watched(*device, settle(on), data.train, kNone, start(on));
      const auto nothing = [](int) {};
      const TrainState a = run(plain, nothing).end, b = run(watched, nothing).end;
      CHECK(a.adam_steps == b.adam_steps);
      for (const auto& [x, y] :
           {std::pair{&a.model.values, &b.model.values}, {&a.moment1, &b.moment1}, {&a.moment2, &b.moment2}})
        CHECK((x->size() == y->size() && std::memcmp(x->data(), y->data(), x->size() * sizeof(float)) == 0));
    }
}

TEST_CASE("guard: with on_nan = stop, the error message contains splat, iteration and stage", "[guard]") {
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
        Trainer trainer(*device, settle(settings), data.train, kNone, start(settings));
        const Run result = run(trainer, [&](int iteration) {
          if (iteration == 20) poison(*device, trainer, row.row, 123, row.value);
        });
        CHECK(test::contains(result.message, "not finite at iteration 21, stage parameters, splat 123"));
        CHECK(result.warnings.empty());
        CHECK_FALSE(trainer.state_is_consistent());
        CHECK(trainer.iteration() == 21);
      }
    }
}

// Gives a splat finite parameters whose gradient is not finite, because SSIM squares its colours, which are
// 1e38. Requires LenientKernels, because other kernels cull such a splat.
void make_glaring(Device& device, Trainer& trainer, const Camera& camera, std::uint32_t splat) {
  const std::array<double, 3> centre = camera.centre();
  for (int c = 0; c < 3; ++c)
    poison(device, trainer, c, splat, static_cast<float>(0.5 * centre[static_cast<std::size_t>(c)]));
  for (int c = 3; c < 6; ++c) poison(device, trainer, c, splat, 1e38f);
  poison(device, trainer, 6, splat, 10.0f);
  for (int r = 8; r < 11; ++r) poison(device, trainer, r, splat, -8.0f);  // visible from every direction
  for (int r = 14; r < 17; ++r) poison(device, trainer, r, splat, -1.0f);
}

TEST_CASE("guard: if a gradient is not finite, the message contains its stage and view", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  const test::LenientKernels kernels;
  {
    const std::unique_ptr<Device> device = open_device("opencl");
    const TrainSettings settings = guarded(OnNan::stop);
    Trainer trainer(*device, settle(settings), data.train, kNone, start(settings));
    const Run result = run(trainer, [&](int iteration) {
      if (iteration == 25) make_glaring(*device, trainer, data.train.views[0].camera, 7);
    });
    INFO(result.message);
    CHECK((test::contains(result.message, "stage image_loss") ||
           test::contains(result.message, "stage raster_forward")));
    ViewOrder order(settings.seed, 6);
    const std::uint32_t view = order(static_cast<std::uint64_t>(trainer.iteration()) - 1);
    CHECK(test::contains(result.message, fmt::format("view '{}'", data.train.views[view].name)));
  }
}

// Spoiler passes all operations on to `stages`. After the operation with the index `operation`, it sets one
// value of the output to NaN.
class Spoiler final : public Stages {
 public:
  Spoiler(Device& device, Stages& stages, std::size_t operation)
      : device_(device), stages_(stages), operation_(operation) {}
  const KernelConfig& config() const override { return stages_.config(); }
  Outcome run(const Operation& operation) override {
    Outcome outcome = stages_.run(operation);
    const auto spoil = [&](const BufferView<float>& values, std::size_t at) {
      if (operation.index() != operation_) return;
      REQUIRE(at < values.size);
      device_.write(*values.memory, at * sizeof(float), std::as_bytes(std::span(&kNan, 1)));
    };
    run_case(
        operation,
        [&](const ProjectForward& a) {
          const auto tiles = read_values(device_, a.tile_counts, a.splats.count);
          const auto shown = std::ranges::find_if(tiles, [](std::uint32_t n) { return n > 0; });
          spoil(a.records, static_cast<std::size_t>(shown - tiles.begin()) * kSplatStride + kSplatOpacity);
        },
        [&](const RasterForward& a) { spoil(a.image, 0); }, [&](const ImageLoss& a) { spoil(a.v_image, 0); },
        [&](const SumSlots& a) { spoil(a.v_records, kGradR); },
        [&](const ProjectBackward& a) { spoil(a.v_params, 0); }, [](const auto&) {});
    return outcome;
  }

 private:
  Device& device_;
  Stages& stages_;
  std::size_t operation_;
};

TEST_CASE("guard: find_nonfinite_source() returns the first stage whose output is not finite", "[guard]") {
  const Data data = synthetic("glossy", 32, 2);
  for (const auto& device : devices_under_test())
    for (const std::string& raster : raster_names_of(*device)) {
      TrainSettings settings = guarded(OnNan::stop);
      settings.raster = raster;
      const auto stages = make_stages(*device, training_config(settings, device->info()));
      TrainingViews views(*device, settings, data.train, kNone);
      TrainState state;
      state.model = start(settings);
      state.iteration = 1;
      const auto found = [&](Stages& through) {
        return find_nonfinite_source(*device, through, views, render_settings(settings), state);
      };
      CHECK(found(*stages).stage == "adam");  // is returned if the outputs of all other stages are finite
      for (const auto& [operation, name] : {std::pair{operation_index<ProjectForward>(), "project_forward"},
                                            {operation_index<RasterForward>(), "raster_forward"},
                                            {operation_index<ImageLoss>(), "image_loss"},
                                            {operation_index<SumSlots>(), "raster_backward"},
                                            {operation_index<ProjectBackward>(), "project_backward"}}) {
        INFO(device->info().name << ", raster " << raster << ", " << name);
        Spoiler spoiler(*device, *stages, operation);
        const NonFiniteSource source = found(spoiler);
        CHECK(source.stage == name);
        CHECK(source.view == static_cast<std::int64_t>(views.view_of(0)));
      }
      state.model.values[5] = kInf;
      CHECK(found(*stages).stage == "parameters");
    }
}

TEST_CASE("guard: with on_nan = drop, the splat is removed and the final model is finite", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = guarded(OnNan::drop);
    settings.appearance = Appearance::gain;
    Trainer trainer(*device, settle(settings), data.train, kNone, start(settings));
    const Run result = run(trainer, [&](int iteration) {
      if (iteration == 20) poison(*device, trainer, 2, 50, kNan);
      if (iteration == 40) poison(*device, trainer, 14, 51, kInf);
    });
    INFO(result.message);
    CHECK(result.message.empty());
    CHECK(result.warnings.size() == 2);
    CHECK(result.end.dropped == 2);
    CHECK(result.end.iteration == kIterations);
    CHECK(is_finite(result.end));

    // If too many splats are not finite (here more than ten), training ends with an error.
    Trainer worse(*device, settle(settings), data.train, kNone, start(settings));
    const Run stopped = run(worse, [&](int iteration) {
      if (iteration == 20)
        for (std::uint32_t i = 0; i < 11; ++i) poison(*device, worse, 0, i, kNan);
    });
    CHECK(stopped.message.find("11 splats would have been dropped in this run, but at most 10 are allowed") !=
          std::string::npos);
  }
}

// Earlier iterations are checked for finite values before cameras are refined. Otherwise, a run that goes
// back to one of these iterations would refine the cameras twice.
TEST_CASE("guard: cameras are only refined after earlier iterations have been checked", "[guard]") {
  const Data data = synthetic("glossy", 64, 4);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = short_run(6, kIterations, 300);
    settings.refine.end = settings.refine.first;
    settings.refine_cameras = RefineCameras::pose;
    settings.on_nan = OnNan::drop;
    settings.log_every = kIterations;
    const Schedule schedule(settings, 300);
    REQUIRE((schedule.camera_sweep(16) && !schedule.camera_sweep(17) && schedule.camera_sweep(19)));
    Trainer trainer(*device, settle(settings), data.train, kNone, start(settings));
    std::vector<double> before, found;
    trainer.on_nonfinite([&](const std::string& message) {
      CHECK(test::contains(message, "at iteration 17,"));
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

TEST_CASE("guard: with on_nan = rollback, training continues from the last state, at most three times",
          "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  const test::LenientKernels kernels;
  {
    const std::unique_ptr<Device> device = open_device("opencl");
    TrainSettings settings = guarded(OnNan::rollback);
    settings.appearance = Appearance::affine;
    Trainer trainer(*device, settle(settings), data.train, kNone, start(settings));
    int states = 0;
    trainer.on_state({16, 0, [&](const TrainState&) { ++states; }});
    bool once = false;
    const Run result = run(trainer, [&](int iteration) {
      if (iteration == 25 && !std::exchange(once, true))
        make_glaring(*device, trainer, data.train.views[0].camera, 7);
    });
    INFO(result.message);
    CHECK(result.message.empty());
    REQUIRE(result.warnings.size() == 1);
    CHECK(test::contains(result.warnings[0], "back to iteration 16"));
    CHECK(result.end.iteration == kIterations);
    CHECK(result.end.rollbacks == 1);
    REQUIRE(result.end.skipped_draws.size() == 1);
    const std::uint64_t skipped = *result.end.skipped_draws.begin();
    CHECK(test::contains(result.warnings[0], fmt::format("not finite at iteration {},", skipped + 1)));
    CHECK(is_finite(result.end));
    CHECK(states >= 3);

    // In this run, a NaN is written again after each rollback.
    Trainer again(*device, settle(settings), data.train, kNone, start(settings));
    const Run stopped = run(again, [&](int iteration) {
      if (iteration == 25) poison(*device, again, 0, 3, kNan);
    });
    CHECK(stopped.warnings.size() == static_cast<std::size_t>(kMaxRollbacks));
    CHECK(stopped.message.find("stopped after 3 rollbacks") != std::string::npos);
  }
}

TEST_CASE("guard: a moment that is not finite is detected with batches of several views", "[guard]") {
  const Data data = synthetic("glossy", 32, 6);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = guarded(OnNan::stop);
    settings.batch = 3;
    Trainer trainer(*device, settle(settings), data.train, kNone, start(settings));
    const Run result = run(trainer, [&](int iteration) {
      if (iteration != 10) return;
      TrainState state = trainer.state();
      state.moment2[17 * state.model.count + 200] = kInf;
      trainer.restore(state);
    });
    // The moments depend on all three views of the batch, so the message does not name a view.
    CHECK(test::contains(result.message, "not finite at iteration 11, stage adam, splat 200"));
  }
}

}  // namespace
}  // namespace ubs
