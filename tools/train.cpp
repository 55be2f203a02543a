// SPDX-License-Identifier: Apache-2.0
// ubs train: learns a model from a data folder and leaves it with its measurements in an output folder.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/base/stopwatch.hpp"
#include "host/base/text.hpp"
#include "host/run/open_data.hpp"
#include "host/run/proved_device.hpp"
#include "host/run/same_run.hpp"
#include "host/run/training_data.hpp"
#include "host/serve/live.hpp"
#include "host/spec/settings.hpp"
#include "host/train/budget.hpp"
#include "host/train/expected_time.hpp"
#include "host/train/rehearsal.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/shared_splats.hpp"
#include "host/train/timed_end.hpp"
#include "host/train/trainer.hpp"
#include "tools/commands.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/job.hpp"
#include "tools/common/lpips_options.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/plan_text.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/run_folder.hpp"
#include "tools/common/run_keeper.hpp"
#include "tools/common/serve_options.hpp"
#include "tools/help.hpp"
#include "tools/train_report.hpp"
#include "tools/train_start.hpp"

namespace ubs::tools {
namespace {

struct TrainOptions {
  explicit TrainOptions(CLI::App& app) : settings(app), lpips(app), serve(app) {}
  SettingsOptions settings;
  LpipsOptions lpips;
  ServeOptions serve;
  StartOptions start;
  std::string device;
  double serve_share = serve::kShare;
  bool quiet = false, json = false;
  bool talkative() const { return !quiet && !json; }
};

constexpr int kProbeIterations = 600;        // a budget is measured with the splats of such a short run
constexpr double kUnaskedMeasuring = 0.3;    // less time is spent on it when nobody asked
constexpr int kMinPlannedIterations = 1000;  // a plan costs as much as ten to a hundred

// `end`: changes the settings once.
Outcome train(Trainer& trainer, RunFolder& folder, RunKeeper& keeper, Progress& progress,
              const InterruptGuard& guard, TrainSettings& settings, std::optional<TimedEnd>& end,
              serve::LiveTraining* live) {
  Outcome outcome;
  trainer.run([&](const StepReport& report) {
    if (const auto ending = end ? end->after(report) : std::nullopt) {
      settings.iterations = ending->iterations;
      settings.lr_cooldown = ending->lr_cooldown;
      trainer.end_as(settings);
      keeper.use(settings);
      try {
        folder.write_config(settings);
      } catch (const Error& error) {  // a full disk: as with a checkpoint, training goes on
        warn("config.yaml has other iterations than the run: {}", error.what());
      }
    }
    if (report.loss) {
      folder.log(report);
      progress.update(report);
    }
    if (report.test) outcome.evaluation = {report.iteration, report.seconds, *report.test};
    if (live) live->step(report);
    outcome.interrupted = guard.interrupted() && report.iteration < settings.iterations;
    return !outcome.interrupted;
  });
  progress.finish();
  outcome.interrupted = ranks().of_first(outcome.interrupted) != 0;
  if (live) live->end();
  return outcome;
}

// As train(); after an error that leaves the state whole (an image that cannot be read, no memory) it is
// kept.
Outcome train_and_keep(Trainer& trainer, RunFolder& folder, RunKeeper& keeper, Progress& progress,
                       const InterruptGuard& guard, TrainSettings& settings, std::optional<TimedEnd>& end,
                       serve::LiveTraining* live) {
  const RunInterval interval = checkpoint_interval(settings);
  trainer.on_state(
      {interval.iterations, interval.seconds, [&](const TrainState& state) { keeper.save(state); }});
  trainer.on_nonfinite([&](const NonFiniteEvent& event) {
    progress.finish();
    keeper.report(event, "train");
  });
  try {
    const Outcome outcome = train(trainer, folder, keeper, progress, guard, settings, end, live);
    if (outcome.interrupted) keeper.save(trainer.state());
    return outcome;
  } catch (const Error& error) {
    progress.finish();
    if (ranks().size() > 1) throw;  // the others do not know
    try {
      if (trainer.state_is_whole() && trainer.iteration() > 0) keeper.save(trainer.state());
    } catch (const Error&) {  // the device is gone: the first error says why
    }
    if (keeper.saved_iteration() < 0) throw;
    throw Error(error.kind(),
                fmt::format("{}; the state of iteration {} is kept: ubs train --resume {}", error.what(),
                            keeper.saved_iteration(), shell_word(folder.path().string())));
  }
}

// Finds out before hours of training whether the networks can be had and take the test images.
std::unique_ptr<ImageMetrics> open_networks(Device& device, const LpipsRequest& request, const Split& test) {
  auto metrics = std::make_unique<ImageMetrics>(device, request);
  for (const View& view : test.views) metrics->check_size({view.camera.width, view.camera.height});
  return metrics;
}

// A run that was continued behind its last iteration has not measured there.
void measure_end(Trainer& trainer, const Split& test, Outcome& outcome) {
  if (outcome.interrupted || outcome.evaluation || test.views.empty()) return;
  outcome.evaluation = {trainer.iteration(), trainer.seconds(), trainer.evaluate_test()};
}

// The last evaluation again, with what training itself does not measure.
void measure_finally(Device& device, const LpipsRequest& request, Trainer& trainer, Outcome& outcome) {
  if (outcome.interrupted || !outcome.evaluation) return;
  ImageMetrics more(device, request);
  outcome.evaluation->metrics = trainer.evaluate_test(&more);
}

void say_background(const PictureFacts& facts) {
  if (facts.mean_colour)
    say("         background {}: the mean colour of the pictures (--background)\n",
        fmt::join(*facts.mean_colour, ","));
}

// A schedule for --budget, or for kUnaskedBudget, in the place of the settings', and what it is expected to
// take.
RunFigures choose_schedule(const TrainOptions& options, Start& start, Device& device, Dataset& data,
                           const Split& train, const PictureFacts& pictures) {
  const bool asked = !options.start.budget.empty();
  const std::size_t points = points_of(data);
  const TrainSettings base = schedule_base(start);
  TrainSettings probe = base;
  probe.cap_max = std::min(probe.cap_max, short_run_splats(kProbeIterations, points));
  const double budget = asked ? budget_seconds(options.start.budget) : kUnaskedBudget;
  const SplatModel first = initial_model(data, train, probe);
  StepCosts costs = measure_steps(device, base, train, first, points > 0,
                                  asked ? budget : kUnaskedBudget * kUnaskedMeasuring);
  BudgetRun run = fit_budget(costs, base, train, points, budget, pictures);
  const TrainSettings short_run = rehearsal(run, base, points, budget);
  rehearse_budget(device, short_run, train, initial_model(data, train, run.settings), costs);
  run = fit_budget(costs, base, train, points, budget, pictures);
  BudgetRun aimed =
      fit_budget(costs, base, train, points, budget, pictures, has_time(base.dim) ? kAimMoving : kAim);
  // A stretch that somebody has set leaves nothing to fit.
  const bool timed =
      !run.longest && base.lr_cooldown.stretch == 1 && TimedEnd::can_time(aimed.settings, train);
  if (timed) run = std::move(aimed);
  start.settings = run.settings;
  const double step_ms = 1e3 * run.seconds / run.settings.iterations;
  if (timed) start.end_seconds = run.seconds = budget;
  const PlanInterval times =
      timed ? PlanInterval{kEndLeast, kEndMost} : PlanInterval{kBudgetLeast, kBudgetMost};
  if (options.talkative())
    say("budget   {}, measured in {}: {}{} iterations, at most {} splats; expected {}{}\n",
        duration_text(budget), duration_text(costs.spent), timed ? "about " : "", run.settings.iterations,
        run.settings.cap_max, interval_text(run.seconds, times.least, times.most),
        run.longest ? "; more time would change nothing" : "");
  if (options.talkative()) say_background(pictures);
  flush_out();
  return RunFigures{.seconds = run.seconds, .step_ms = step_ms, .times = times, .curve = run.curve};
}

// The plan of a new run that is long enough for one; of a continued one, its seconds.
RunFigures planned_figures(const TrainOptions& options, const Start& start, Device& device,
                           const Split& train, const Split& test, const SplatModel& initial,
                           bool from_points) {
  if (start.checkpoint) return {.seconds = start.checkpoint->planned_seconds};
  if (options.start.no_plan || start.settings.iterations < kMinPlannedIterations) return {};
  const RunPlan plan = plan_training(device, start.settings, train, test, initial, from_points, false);
  device.reset_peak();
  return figures_of(plan, device.info());
}

// Not of a schedule that was fitted to a time: that has been said.
void print_plan(const RunFigures& planned) {
  if (planned.memory_bytes > 0) say("plan     {}\n", figures_text(planned));
  flush_out();
}

// The schedule where none was asked for: a long one, with its plan, or a short one where that would take too
// long. Ranks that share a training have no plan and take the long one.
RunFigures schedule_unasked(const TrainOptions& options, Start& start, Device& device, Dataset& data,
                            const Split& train, const Split& test, const PictureFacts& pictures) {
  start.settings = unasked_schedule(start, data, pictures);
  const RunFigures planned = ranks().size() > 1 ? RunFigures{}
                                                : planned_figures(options, start, device, train, test,
                                                                  initial_model(data, train, start.settings),
                                                                  data.points.has_value());
  const bool fits = planned.seconds <= kLongestUnasked;
  if (options.talkative())
    say("schedule {} iterations{}\n"
        "         (--iterations {} for the published one, --budget TIME for another time)\n",
        kUnaskedIterations,
        fits ? fmt::format(", at most {} splats", start.settings.cap_max)
             : fmt::format(" would take about {} here: shortened to {}", duration_text(planned.seconds),
                           duration_text(kUnaskedBudget)),
        kScheduleLength);
  if (fits && options.talkative()) say_background(pictures);
  if (fits) return planned;
  flush_out();  // what is measured next takes half a minute
  return choose_schedule(options, start, device, data, train, pictures);
}

serve::Scene live_scene(const Start& start, const Split& train, const SplatModel& initial) {
  const std::vector<Camera> cameras = cameras_of(train);
  serve::Scene scene{.title = std::filesystem::path(start.out).filename().string(),
                     .frame = scene_frame({{initial}}, cameras),
                     .has_time = has_time(initial.dim)};
  const std::size_t step = (cameras.size() + serve::kMaxCameras - 1) / serve::kMaxCameras;
  for (std::size_t i = 0; i < cameras.size(); i += step)
    scene.cameras.push_back({.name = train.views[i].name, .camera = cameras[i]});
  return scene;
}

// The folder as it is at the beginning of a run, the trainer as it was at its end where it is continued.
void begin(const Start& start, RunFolder& folder, Trainer& trainer, bool talkative) {
  if (!start.checkpoint) return folder.begin(start.settings);
  trainer.restore(start.checkpoint->state);
  folder.resume(start.settings, trainer.iteration());
  if (talkative) say("resumed  at iteration {}, {:.1f} s\n", trainer.iteration(), trainer.seconds());
}

template <typename Work>
double seconds_of(Work work) {
  const auto start = Clock::now();
  work();
  return seconds_since(start);
}

check::Use use_of(const TrainSettings& settings, const TrainOptions& options) {
  check::Use use = training_use(settings);
  if (options.lpips.wanted()) use.parts.push_back(check::Part::networks);
  return use;
}

// From the state after the last iteration to the end of the run: `write` leaves all results. They may fail,
// by a full disk, or be killed; as long as the state is there `ubs train --resume` makes them again, so it
// goes last.
void finish(RunFolder& folder, RunKeeper& keeper, const Trainer& trainer, const TrainSettings& settings,
            const std::function<void()>& write) {
  const RunInterval interval = checkpoint_interval(settings);
  if (interval.iterations > 0 || interval.seconds > 0) keeper.save(trainer.state());
  try {
    write();
    folder.sync_log();
  } catch (const Error& error) {
    if (keeper.saved_iteration() < 0) throw;
    throw Error(error.kind(),
                fmt::format("{}; the results can be had from iteration {} on: ubs train --resume {}",
                            error.what(), keeper.saved_iteration(), shell_word(folder.path().string())));
  }
  folder.remove_checkpoint();
}

// The rest of its share and of its memory is that of the other ranks.
void rehearse(Device& device, TrainSettings settings, const Split& train, const Split& test,
              const SplatModel& initial, ImageMetrics* networks) {
  const auto all = static_cast<std::uint32_t>(initial.count);
  const std::uint32_t own = largest_share(all, ranks().size());
  settings.cap_max =
      static_cast<int>(largest_share(static_cast<std::uint32_t>(settings.cap_max), ranks().size()));
  build_kernels(device, settings, train, test, own == all ? initial : part_of(initial, {0, own}), networks);
}

// Ranks whose devices are faster draw more views. What was measured at the start of a run holds for all of
// it.
std::vector<std::uint64_t> deal_by_speed(const Start& start, Device& device, const Split& train,
                                         const SplatModel& initial) {
  const auto size = static_cast<std::size_t>(ranks().size());
  if (start.checkpoint && start.checkpoint->views_by_rank.size() == size)
    return start.checkpoint->views_by_rank;
  std::vector<float> speeds(size);
  speeds[static_cast<std::size_t>(ranks().rank())] =
      static_cast<float>(1 / view_seconds(device, start.settings, train, initial));
  ranks().merge(speeds);
  const std::vector<double> measured(speeds.begin(), speeds.end());
  return Deal(static_cast<std::uint64_t>(start.settings.batch), ranks().size(), measured).counts();
}

// Of a job with several ranks: what one process measures beforehand says nothing about it, and none has the
// model that a visitor would see.
void check_shared(const TrainOptions& options) {
  if (!options.start.budget.empty())
    fail(ErrorKind::usage, "--budget measures one process: choose --iterations where ranks share a training");
  if (options.serve.option().count() > 0)
    fail(ErrorKind::usage,
         "--serve shows the model of one process: leave it out where ranks share a training");
}

int run(const TrainOptions& options) {
  files_before_output();
  const LpipsRequest lpips = options.lpips.request();
  Start start = start_of(options.start, options.settings, ranks().first());
  if (ranks().size() > 1) check_shared(options);
  TrainSettings& settings = start.settings;
  RunFolder folder(start.out, ranks().first());
  if (!start.checkpoint) folder.check_new(options.start.overwrite);
  const std::unique_ptr<serve::Server> server = options.serve.open();
  std::optional<EndOnRequest> beforehand(std::in_place);
  Dataset data = open_dataset(start.data, {"train", "test"}, settings, Images::load);
  Json chosen = Json::array();  // not set by anyone
  if (settings.dim == kAutoInt) chosen.push_back("dim");
  if (settings.conditioning_auto) chosen.push_back("conditioning");
  const Split* const given = data.find("train");
  const std::uint32_t data_print = given ? fingerprint(*given) : 0;  // before cameras are moved
  const Split train_split = take_train(data, settings, !start.checkpoint);
  const Split test_split = take_test(data, settings);
  folder.check_renders(test_split, settings.save_renders);
  const std::unique_ptr<Device> device =
      open_proved_device(device_of_rank(options.device), use_of(settings, options));
  std::unique_ptr<ImageMetrics> networks;
  if (options.lpips.wanted()) networks = open_networks(*device, lpips, test_split);
  if (options.talkative()) print_start(data, train_split, test_split, settings, *device);
  if (options.talkative() && options.start.out.empty() && !start.checkpoint)
    say("output   {} (--out to choose)\n", start.out);
  Checkpoint run =
      identity(settings, absolute_path(start.data).lexically_normal().string(), data_print, *device);
  const int device_kinds = join_run(ranks(), run);
  if (start.checkpoint) check_same_run(*start.checkpoint, run, options.start.any_device);
  RunFigures planned;
  if (start.shortened) {
    const PictureFacts pictures = facts_of(train_split, settings);
    planned = options.start.budget.empty()
                  ? schedule_unasked(options, start, *device, data, train_split, test_split, pictures)
                  : choose_schedule(options, start, *device, data, train_split, pictures);
  }
  run.settings = settings;
  run.end_seconds = start.end_seconds;
  const SplatModel initial =
      start.checkpoint ? start.checkpoint->state.model : initial_model(data, train_split, settings);
  const double build_seconds =
      seconds_of([&] { rehearse(*device, settings, train_split, test_split, initial, networks.get()); });
  if (options.talkative())
    say("kernels  ready in {:.1f} s, before the clock of training starts\n{} {} splats\n", build_seconds,
        start.checkpoint ? "state   " : "begins  ", initial.count);
  networks.reset();  // its memory is no part of training's
  device->reset_peak();
  if (!start.shortened && ranks().size() == 1)
    planned =
        planned_figures(options, start, *device, train_split, test_split, initial, data.points.has_value());
  if (options.talkative()) print_plan(planned);
  run.planned_seconds = planned.seconds;
  Trainer trainer(*device, settings, train_split, test_split, initial, ranks());
  if (device_kinds > 1) {
    run.views_by_rank = deal_by_speed(start, *device, train_split, initial);
    trainer.deal_views(run.views_by_rank);
  }
  // From the first change of a file to the last. A request that comes behind the last step does not cut the
  // results short.
  beforehand.reset();
  const InterruptGuard guard;
  begin(start, folder, trainer, options.talkative());
  const std::vector<std::string> comments = model_comments(data, settings, train_split);
  RunKeeper keeper(folder, std::move(run), comments, start.checkpoint ? trainer.iteration() : -1);
  if (planned.curve.empty())
    planned.curve = assumed_curve(settings, first_splats(data, train_split, settings));
  Progress progress(settings.iterations, options.quiet || !ranks().first(), planned.curve);
  std::optional<serve::LiveTraining> live;
  if (server)
    live.emplace(*server, options.serve_share, *device, trainer, settings,
                 live_scene(start, train_split, initial), planned.curve);
  std::optional<TimedEnd> end;
  if (start.end_seconds > 0) end.emplace(start.end_seconds, settings, train_split);
  Outcome outcome =
      train_and_keep(trainer, folder, keeper, progress, guard, settings, end, live ? &*live : nullptr);

  const Background::Learnt learnt = settings.background.learnt;
  RunFigures actual;
  Json json;
  std::size_t renders = 0;
  const auto write_results = [&] {
    const TrainSettings drawn = trainer.drawn_settings();
    folder.save_model(trainer.model(), model_comments(data, drawn, train_split));
    measure_end(trainer, test_split, outcome);
    actual = actual_figures(trainer, *device);
    std::vector<double> differences;
    if (device_kinds > 1) differences = trainer.picture_differences(0);
    if (options.lpips.wanted()) measure_finally(*device, lpips, trainer, outcome);
    if (ranks().first()) {
      json = run_json(start, *device, actual.memory_bytes, trainer, outcome);
      json["kernel_seconds"] = build_seconds;
      if (!chosen.empty()) json["chosen"] = chosen;
      if (learnt != Background::Learnt::no) json["learnt_background"] = to_string(drawn.background);
      json["storage_bytes"] = file_bytes(folder.model());
      json["data_report"] = report_json(data.report);
      json["offset"] = data.offset;
      json["data_print"] = data_print;
      if (device_kinds > 1) json["picture_differences_by_rank"] = differences;
      json["planned"] = figures_json(planned);
      json["actual"] = figures_json(actual);
      folder.save_metrics(json);
    }
    folder.save_cameras(trainer, train_split, test_split, data.offset, !outcome.interrupted);
    if (!outcome.interrupted) renders = folder.save_renders(trainer, test_split, settings.save_renders);
  };
  if (outcome.interrupted)
    write_results();
  else
    finish(folder, keeper, trainer, settings, write_results);
  if (options.json) print_json(json);
  if (options.talkative()) {
    print_summary(start, folder, trainer, outcome, actual.memory_bytes, renders);
    if (learnt != Background::Learnt::no)
      say("learnt   background {}{}\n", fmt::join(trainer.drawn_settings().background.colour, ","),
          learnt == Background::Learnt::sky ? " on average over all directions" : "");
    if (!outcome.interrupted) say("{}", comparison_text(planned, actual));
    if (live) say("live     {}\n", live->summary());
  }
  return guard.interrupted() ? kInterruptedExitCode : 0;
}

}  // namespace

Command add_train(CLI::App& root) {
  CLI::App* app = root.add_subcommand("train", "Learn a model from a data set");
  const auto options = std::make_shared<TrainOptions>(*app);
  app->add_option(
         "data,--data", options->start.data,
         "data folder: Blender, D-NeRF, nerfstudio, COLMAP, LLFF or N3V (docs/data.md); or packed file")
      ->type_name("DIR|FILE");
  app->get_option("--dim")->description(kAutoDimHelp);
  app->add_option("--out", options->start.out,
                  "output folder: model.ply, metrics.json, log.csv, config.yaml, checkpoint.ubs, renders/ "
                  "[beside the data: NAME-ubs, NAME-ubs-2, ...]")
      ->type_name("DIR");
  app->add_option(
         "--budget", options->start.budget,
         fmt::format(
             "train for about this time, such as 90s, 10m or 1h: chooses iterations, splats and growth "
             "beforehand (docs/budget.md) [without --iterations {} of them, or 15m where these would "
             "take more than an hour]",
             kUnaskedIterations))
      ->type_name("TIME");
  app->add_option(
         "--resume", options->start.resume,
         "go on with the run in this output folder, which was interrupted, with the data and settings it has")
      ->type_name("DIR");
  app->add_flag("--any-device", options->start.any_device,
                "with --resume: also on another device (other bits)")
      ->needs("--resume")
      ->group(kRareGroup);
  app->add_flag("--no-plan", options->start.no_plan,
                "measure nothing before training but what a budget needs (see 'ubs plan')")
      ->group(kRareGroup);
  app->add_flag("--overwrite", options->start.overwrite, "replace the model in the output folder");
  add_device_option(*app, options->device);
  app->add_option("--serve-share", options->serve_share,
                  "percent of the time of training that visitors of --serve may cost [5]")
      ->needs(&options->serve.option())
      ->check(from_to(0.1, 100.0))
      ->type_name("PERCENT");
  app->add_flag("--quiet", options->quiet, "print errors and warnings only");
  app->add_flag("--json", options->json, "print metrics.json instead of the summary");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
