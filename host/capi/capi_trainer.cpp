// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for training.
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "host/base/stopwatch.hpp"
#include "host/capi/metrics.hpp"
#include "host/run/same_run.hpp"
#include "host/run/training_run.hpp"
#include "host/run/verified_device.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/settings/fields.hpp"

struct ubs_trainer {
  std::shared_ptr<ubs::facade::OpenDevice> open;
  std::unique_ptr<ubs::TrainingRun> run;
  ubs::Checkpoint identity;             // identifies the run; without the training state
  std::optional<ubs::StepReport> last;  // of the current iteration, if this trainer has run it
  bool running = false;

  ubs::Trainer& trainer() { return run->trainer(); }
  const ubs::Trainer& trainer() const { return run->trainer(); }
};

namespace ubs::facade {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// Throws Error(usage) if a setting that determines how data are read has another value than it had when the
// data were opened. The data have been read already, so such a setting would have no effect.
void check_as_opened(TrainSettings settings, const ubs_data& data) {
  TrainSettings opened = data.settings;
  opened.background.automatic = false;  // an automatic background was black while the data were read
  if (settings.background.automatic) settings.background = opened.background;
  const bool composited = std::ranges::any_of(data.set->splits, [](const Split& split) {
    return std::ranges::any_of(split.views, [](const View& v) { return v.has_image() && !v.opaque; });
  });
  const bool other_background = composited && settings.background.learnt == Background::Learnt::no &&
                                settings.background.colour != opened.background.colour;
  const auto then = bind_fields(opened, train_fields()), now = bind_fields(settings, train_fields());
  for (std::size_t i = 0; i < now.size(); ++i) {
    const std::string_view key = now[i].key;
    const bool reads = (now[i].uses & kOfReading) && !(now[i].uses & kFreeOnResume);
    const bool counts = key == "background" ? other_background : reads && settings.chosen.contains(key);
    const std::string wanted = field_text(now[i]), has = field_text(then[i]);
    if (counts && wanted != has)
      fail(ErrorKind::usage,
           "{} = {} has no effect here, because the data were opened with {}: pass it when you open the data",
           key, wanted, has);
  }
}

// Sets the dimension and the conditioning to those of the initial model, unless they were chosen.
void take_form(const SplatModel& model, TrainSettings& asked) {
  if (asked.dim == kAutoInt) asked.dim = model.dim;
  if (!asked.conditioning_auto) return;
  asked.conditioning_auto = false;
  asked.variant.conditioning = model.variant.conditioning;
}

// Converts a model of the caller to the unit of training, and returns it as the initial model of the
// training. Throws an error if the model cannot be trained with these settings, or has a parameter that is
// not finite.
SplatModel as_first(const LoadedModel& loaded, const TrainingRun& run) {
  const SplatModel& model = loaded.model.single("training");
  if (loaded.offset != run.offset())
    fail(ErrorKind::usage, "the model and the data have different world offsets");
  check_parameters(loaded.model);
  check_initial(run.plan().settings(), model);  // must precede the first kernel that uses the model
  SplatModel first = model;
  scale_lengths(first, 1 / run.plan().unit());
  return first;
}

// Throws Error(usage) if a model has more splats than the trainer has allocated memory for.
void check_room(const ubs_trainer& t, std::size_t splats, const std::string& what) {
  const int room = t.trainer().scene().settings_with_learnt_background().cap_max;
  if (splats > static_cast<std::size_t>(room))
    fail(ErrorKind::usage,
         "{} has {} splats, but the trainer has memory for {} (the larger of cap_max and the number of "
         "splats of the initial model)",
         what, splats, room);
}

ubs_step step_of(const ubs_trainer& t) {
  ubs_step step{};
  step.size = sizeof step;
  step.iteration = static_cast<std::uint32_t>(t.trainer().iteration());
  step.iterations = static_cast<std::uint32_t>(t.trainer().settings().iterations);
  step.seconds = t.trainer().seconds();
  step.splats = t.trainer().splats();
  step.loss = step.test_psnr = step.test_ssim = kNone;
  return step;
}

ubs_step step_of(const ubs_trainer& t, const StepReport& report) {
  ubs_step step = step_of(t);
  step.iteration = static_cast<std::uint32_t>(report.iteration);
  step.seconds = report.seconds;
  step.splats = report.splats;
  step.loss = report.loss.value_or(kNone);
  if (report.test) {
    step.test_psnr = report.test->mean.psnr_channel_mean;
    step.test_ssim = report.test->mean.ssim;
  }
  return step;
}

// Throws Error(usage) if the trainer is running, because its step callback may read and evaluate the trainer,
// but must not change it.
void not_while_running(const ubs_trainer& t) {
  if (t.running)
    fail(ErrorKind::usage,
         "a step callback cannot run the trainer, restore it or replace its splats: return 0 to end the run "
         "first, or run it in parts");
}

void need_whole_state(const ubs_trainer& t, const char* action) {
  if (!t.trainer().state_is_consistent())
    fail(ErrorKind::usage, "cannot {}: an error has stopped the trainer in the middle of an iteration",
         action);
}

// Measures the test views. If `meter` is not null, also measures what it measures.
Metrics evaluated(ubs_trainer& t, ubs_meter* meter) {
  if (t.run->test().views.empty()) fail(ErrorKind::data, "the data set has no test views with images");
  if (!meter) return t.trainer().evaluate_test();
  if (meter->open != t.open)
    fail(ErrorKind::usage, "the trainer and the object that compares images have different devices");
  ImageMetrics& more = meter->comparison->metrics();
  for (const View& view : t.run->test().views) more.check_size({view.camera.width, view.camera.height});
  return t.trainer().evaluate_test(&more);
}

// Sets a flag during its lifetime.
struct Running {
  explicit Running(bool& flag) : flag_(flag) { flag_ = true; }
  ~Running() { flag_ = false; }
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;
  bool& flag_;
};

}  // namespace
}  // namespace ubs::facade

using namespace ubs;
using namespace ubs::facade;

ubs_status ubs_trainer_create(ubs_device* device, const ubs_data* data, const ubs_settings* settings,
                              const ubs_model* initial, ubs_trainer** trainer) {
  return made(trainer, [&] {
    const Stopwatch since_start;
    const std::shared_ptr<OpenDevice> open = given(device, "device").open;
    std::unique_lock lock(open->mutex, std::defer_lock);  // destroyed after `created`
    auto created = std::make_unique<ubs_trainer>();
    ubs_trainer& t = *created;
    TrainSettings asked = settings ? settings->values : TrainSettings{};
    validate(asked);
    t.open = open;
    given(data, "data");
    // Images with transparent pixels were composited with this colour.
    if (asked.background.automatic) asked.background.colour = data->settings.background.colour;
    if (initial) take_form(initial->loaded.model.single("training"), asked);
    check_as_opened(asked, *data);
    t.run = std::make_unique<TrainingRun>(data->set, asked, initial == nullptr);
    TrainingRun& run = *t.run;
    lock.lock();
    Device& opened = *t.open->device;
    double compiling = 0;  // and checking the device; both do not count as time of the budget
    {
      const Stopwatch watch;
      verify_device(opened.info(), t.open->index, run.use());
      compiling += watch.seconds();
    }
    const auto warm_up = [&](const Plan& plan, const SplatModel& first) {
      const Stopwatch watch;
      run.warm_up(opened, plan, first);
      compiling += watch.seconds();
    };
    const auto spent = [&] { return since_start.seconds() - compiling; };
    if (run.time_limit() > 0) run.fit_to_budget(opened, warm_up, spent);
    const SplatModel first = initial ? as_first(initial->loaded, run) : run.initial();
    t.identity = identity(run.plan().recorded(), data->set->report.folder, run.data_print(), opened);
    warm_up(run.plan(), first);
    Trainer& trainer = run.start(opened, first);
    if (run.time_limit() > 0) trainer.keep_to(run.budget_from(spent()));
    return created;
  });
}

void ubs_trainer_free(ubs_trainer* trainer) {
  if (!trainer) return;
  const std::shared_ptr<OpenDevice> open = trainer->open;
  const std::lock_guard lock(open->mutex);
  delete trainer;
}

ubs_status ubs_trainer_run(ubs_trainer* trainer, uint32_t steps, ubs_step_function function, void* user) {
  return guarded([&] {
    ubs_trainer& t = given(trainer, "trainer");
    const std::lock_guard lock(t.open->mutex);
    not_while_running(t);
    const Running running(t.running);
    const std::int64_t last =
        steps == 0 ? std::numeric_limits<std::int64_t>::max() : std::int64_t{t.trainer().iteration()} + steps;
    t.trainer().run([&](const StepReport& report) {
      t.last = report;
      const ubs_step step = step_of(t, report);
      const bool go_on = !function || function(user, &step) != 0;
      return go_on && report.iteration < last;
    });
  });
}

ubs_status ubs_trainer_get_status(const ubs_trainer* trainer, ubs_step* step) {
  return guarded([&] {
    const ubs_trainer& t = given(trainer, "trainer");
    const std::lock_guard lock(t.open->mutex);
    const bool is_current = t.last && t.last->iteration == t.trainer().iteration();
    put(step, is_current ? step_of(t, *t.last) : step_of(t), "step");
  });
}

ubs_status ubs_trainer_get_settings(const ubs_trainer* trainer, ubs_settings** settings) {
  return made(settings, [&] {
    const ubs_trainer& t = given(trainer, "trainer");
    const std::lock_guard lock(t.open->mutex);
    return std::make_unique<ubs_settings>(ubs_settings{t.run->plan().recorded()});
  });
}

ubs_status ubs_trainer_get_model(const ubs_trainer* trainer, ubs_model** model) {
  return made(model, [&] {
    const ubs_trainer& t = given(trainer, "trainer");
    const std::lock_guard lock(t.open->mutex);
    auto made_of = std::make_unique<ubs_model>();
    made_of->loaded.offset = t.run->offset();
    made_of->loaded.notes = t.run->notes();
    made_of->loaded.comments = t.run->comments();
    made_of->loaded.model = t.run->model();
    return made_of;
  });
}

ubs_status ubs_trainer_set_model(ubs_trainer* trainer, const ubs_model* model, const int64_t* from) {
  return guarded([&] {
    ubs_trainer& t = given(trainer, "trainer");
    const LoadedModel& loaded = given(model, "model").loaded;
    const std::lock_guard lock(t.open->mutex);
    not_while_running(t);
    need_whole_state(t, "replace the splats");
    SplatModel next = as_first(loaded, *t.run);
    check_room(t, next.count, "the new model");
    TrainState state = t.trainer().state();
    const std::size_t old = state.model.count;
    const auto moved = [&](const std::vector<float>& moments) {
      const std::size_t rows = old == 0 ? 0 : moments.size() / old;
      std::vector<float> rest(rows * next.count, 0.0f);
      for (std::size_t i = 0; from && i < next.count; ++i) {
        if (from[i] < -1 || from[i] >= static_cast<std::int64_t>(old))
          fail(ErrorKind::usage, "from[{}] = {} is neither -1 nor one of the {} splats", i, from[i], old);
        for (std::size_t r = 0; from[i] >= 0 && r < rows; ++r)
          rest[r * next.count + i] = moments[r * old + static_cast<std::size_t>(from[i])];
      }
      return rest;
    };
    state.moment1 = moved(state.moment1);
    state.moment2 = moved(state.moment2);
    state.model = std::move(next);
    t.trainer().restore(state);
    t.last.reset();
  });
}

ubs_status ubs_trainer_evaluate(ubs_trainer* trainer, ubs_metrics* metrics) {
  return guarded([&] {
    ubs_trainer& t = given(trainer, "trainer");
    const std::lock_guard lock(t.open->mutex);
    put(metrics, metrics_to(evaluated(t, nullptr).mean), "metrics");
  });
}

ubs_status ubs_trainer_evaluate_views(ubs_trainer* trainer, ubs_meter* meter, ubs_metrics* mean, size_t count,
                                      ubs_metrics* views) {
  return guarded([&] {
    ubs_trainer& t = given(trainer, "trainer");
    const std::lock_guard lock(t.open->mutex);
    if (count != t.run->test().views.size())
      fail(ErrorKind::usage, "count is {}, but there are {} test views with images", count,
           t.run->test().views.size());
    const Metrics measured = evaluated(t, meter);
    put(mean, metrics_to(measured.mean), "mean");
    // The struct of the caller may have another size than that of this library.
    auto* const bytes = reinterpret_cast<char*>(&given(views, "views"));
    const std::size_t size = views->size;
    for (std::size_t i = 0; i < count; ++i)
      put(reinterpret_cast<ubs_metrics*>(bytes + i * size), metrics_to(measured.views[i]), "views");
  });
}

ubs_status ubs_trainer_save(const ubs_trainer* trainer, const char* path) {
  return guarded([&] {
    const ubs_trainer& t = given(trainer, "trainer");
    const std::lock_guard lock(t.open->mutex);
    need_whole_state(t, "save the state");
    Checkpoint checkpoint = t.identity;
    checkpoint.settings = t.run->plan().recorded();
    checkpoint.state = t.trainer().state();
    write_checkpoint(&given(path, "path"), checkpoint);
  });
}

ubs_status ubs_trainer_restore(ubs_trainer* trainer, const char* path) {
  return guarded([&] {
    ubs_trainer& t = given(trainer, "trainer");
    const Checkpoint checkpoint = read_checkpoint(&given(path, "path"));
    check_same_settings(checkpoint.settings, t.run->plan().recorded());
    check_same_run(checkpoint, t.identity, false);
    const std::lock_guard lock(t.open->mutex);
    not_while_running(t);
    check_room(t, checkpoint.state.model.count, fmt::format("{}: the state", path));
    t.trainer().restore(checkpoint.state);
    t.last.reset();
  });
}
