// SPDX-License-Identifier: Apache-2.0
// ubs train: trains a model on a data folder and writes it with its measurements to an output folder.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>

#include "host/api/open_data.hpp"
#include "host/api/proved_device.hpp"
#include "host/api/same_run.hpp"
#include "host/api/training_data.hpp"
#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/base/text.hpp"
#include "host/base/warning.hpp"
#include "host/device/registry.hpp"
#include "host/look/serve/live.hpp"
#include "host/scene/settings.hpp"
#include "host/train/kernel_warm_up.hpp"
#include "host/train/measure_steps.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/shared_splats.hpp"
#include "host/train/trainer.hpp"
#include "tools/commands.hpp"
#include "tools/common/help.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/job.hpp"
#include "tools/common/lpips_options.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/page_views.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/run_folder.hpp"
#include "tools/common/run_keeper.hpp"
#include "tools/common/serve_options.hpp"
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
  bool print_settings = false, quiet = false, json = false;
  bool talkative() const { return !quiet && !json; }
};

// Steps are measured with the number of splats of a run with this many iterations.
constexpr int kFewIterations = 600;

// Copies the settings that a time budget or Ctrl-C has changed so far from the trainer to the settings of
// the run.
void take_pace(const Trainer& trainer, TrainSettings& settings) {
  settings.iterations = trainer.settings().iterations;
  settings.work_shares = trainer.settings().work_shares;
  settings.growth_end = trainer.settings().growth_end;
}

// Is called after the first Ctrl-C. Lets the run do the last part of its schedule and end.
void complete_early(Trainer& trainer, const StepReport& report, Progress& progress) {
  const double seconds = cooldown_seconds(report.seconds, report.expected_left());
  trainer.complete_in(seconds);
  progress.finish();
  remark("ubs: Ctrl-C: completing the schedule with a cool-down of about {}; ", duration_text(seconds));
  remark("press Ctrl-C again to end at once and keep a checkpoint\n");
}

Outcome train(Trainer& trainer, RunFolder& folder, Progress& progress, const InterruptGuard& guard,
              serve::LiveTraining* live) {
  Outcome outcome;
  bool completes = false;
  trainer.run([&](const StepReport& report) {
    if (report.loss) {
      folder.log(report);
      progress.update(report);
    }
    if (report.test) outcome.evaluation = {report.iteration, report.seconds, *report.test};
    const bool last = report.iteration == report.iterations;
    // interrupted() is called first. Otherwise, a signal between the two calls that requests the end would
    // only complete the run.
    const bool asked = guard.interrupted();
    outcome.interrupted = guard.must_end() && !last;
    if (live) live->step(report, !outcome.interrupted && !last);
    if (asked && !outcome.interrupted && !last && !completes) {
      completes = true;
      complete_early(trainer, report, progress);
    }
    return !outcome.interrupted;
  });
  progress.finish();
  outcome.interrupted = on_any_rank(outcome.interrupted);
  return outcome;
}

// Calls train(). If the run is interrupted, or if an exception is thrown that leaves the state of the
// training consistent (an image that cannot be read, out of memory), saves the state. If the run was being
// completed early, it keeps the state from before the cool-down instead, from which it can be continued.
Outcome train_and_keep(Trainer& trainer, RunFolder& folder, RunKeeper& keeper, Progress& progress,
                       const InterruptGuard& guard, TrainSettings& settings, serve::LiveTraining* live) {
  const RunInterval interval = checkpoint_interval(settings);
  const auto save = [&](const TrainState& state) {
    take_pace(trainer, settings);
    keeper.save(state, settings);
  };
  const auto keeps_start = [&] {
    const auto& start = trainer.completed_from();
    return start && keeper.saved_iteration() == start->iteration;
  };
  trainer.on_state({interval.iterations, interval.seconds, save});
  trainer.on_nonfinite([&](const std::string& message) {
    progress.finish();
    if (folder.writes()) warn("{}", message);
  });
  try {
    const Outcome outcome = train(trainer, folder, progress, guard, live);
    if (outcome.interrupted && !keeps_start()) save(trainer.state());
    return outcome;
  } catch (const std::exception& exception) {
    const Error error = as_error(exception);
    progress.finish();
    if (ranks().size() > 1) throw;  // other ranks do not know about the exception
    try {
      if (trainer.state_is_whole() && trainer.iteration() > 0 && !keeps_start()) save(trainer.state());
    } catch (const std::exception&) {  // the device is lost: report the first error
    }
    if (keeper.saved_iteration() < 0) throw;
    throw Error(error.kind(),
                fmt::format("{}; the state at iteration {} was saved: resume with 'ubs train --resume {}'",
                            error.what(), keeper.saved_iteration(), shell_word(folder.path().string())));
  }
}

// Checks, before hours of training, that the LPIPS networks can be loaded and support the sizes of the test
// images.
std::unique_ptr<ImageMetrics> open_networks(Device& device, const LpipsRequest& request, const Split& test) {
  auto metrics = std::make_unique<ImageMetrics>(device, request);
  for (const View& view : test.views) metrics->check_size({view.camera.width, view.camera.height});
  return metrics;
}

// Measures a run that was resumed after its last iteration, because it has no measurement there.
void measure_end(Trainer& trainer, const Split& test, Outcome& outcome) {
  if (outcome.interrupted || outcome.evaluation || test.views.empty()) return;
  outcome.evaluation = {trainer.iteration(), trainer.seconds(), trainer.evaluate_test()};
}

// Repeats the last evaluation with the metrics that training does not compute.
void measure_finally(Device& device, const LpipsRequest& request, Trainer& trainer, Outcome& outcome) {
  if (outcome.interrupted || !outcome.evaluation) return;
  ImageMetrics more(device, request);
  outcome.evaluation->metrics = trainer.evaluate_test(&more);
}

// Describes the image pyramid of a run; empty if it trains on full-size images only.
std::string sizes_text(const std::vector<PyramidLevel>& levels) {
  std::string text;
  for (const PyramidLevel& level : levels)
    text += level.factor > 1
                ? fmt::format("1/{} of the width and height until {:.0f} % of the work is done, ",
                              level.factor, 100 * level.until)
                : "then full size";
  return levels.size() > 1 ? text : "";
}

// Chooses the number of iterations of a run if the user did not choose it, completes the settings, and
// returns the time budget. The number is the largest that is expected to fit the time budget. With several
// ranks, there is no time budget and the run gets kDefaultIterations. `warm_up` is called before steps are
// measured. `spent` returns the seconds of the budget that have passed.
TimeBudget choose_settings(const TrainOptions& options, Start& start, Device& device, const Dataset& data,
                           const Split& train,
                           const std::function<void(const TrainSettings&, const SplatModel&)>& warm_up,
                           const std::function<double()>& spent) {
  const bool asked = !options.start.budget.empty();
  const PictureFacts pictures = picture_facts(train, start.settings);
  TimeBudget budget{.seconds = asked ? time_budget_seconds(options.start.budget) : kDefaultSeconds,
                    .most_iterations = asked ? kScheduleLength : kDefaultIterations};
  if (ranks().size() > 1) {
    start.settings = default_settings(start, data, pictures);
    budget = {};
  } else {
    const TrainSettings base = fast_base(start);
    const TrainSettings few = fast_settings_for(base, kFewIterations, points_of(data), pictures);
    const SplatModel initial = initial_model(data, train, in_unit(few));
    if (options.talkative()) {
      say("steps    being measured, to choose the number of iterations\n");
      flush_out();
    }
    warm_up(few, initial);
    budget.costs = measure_steps(device, in_unit(few), train, initial, 2 * initial.count);
    budget.spent = spent();
    BudgetedRun run = choose_iterations(std::move(budget), base, train, points_of(data), pictures);
    start.settings = std::move(run.settings);
    budget = std::move(run.budget);
  }
  const bool ends_early = budget.seconds > 0 && start.settings.iterations < budget.most_iterations;
  if (options.talkative()) {
    say("schedule {}{} iterations{}, at most {} splats\n", ends_early ? "about " : "",
        start.settings.iterations,
        budget.seconds > 0
            ? fmt::format(" in the {} that are left of {}", duration_text(budget.seconds - budget.spent),
                          duration_text(budget.seconds))
            : "",
        start.settings.cap_max);
    if (!asked)
      say("         (--iterations {} for the published schedule, --budget TIME for another time)\n",
          kScheduleLength);
    if (const std::string sizes = sizes_text(pyramid_levels(start.settings, train)); !sizes.empty())
      say("images   {}\n", sizes);
  }
  flush_out();
  return budget;
}

// Prepares the folder for a new run. For a resumed run, restores the state of the trainer and continues the
// log.
void begin(const Start& start, RunFolder& folder, Trainer& trainer, bool talkative) {
  if (!start.checkpoint) return folder.begin(start.settings);
  trainer.restore(start.checkpoint->state);
  folder.resume(start.settings, trainer.iteration());
  if (talkative) say("resumed  at iteration {}, {:.1f} s\n", trainer.iteration(), trainer.seconds());
}

template <typename Work>
double seconds_of(Work work) {
  const Stopwatch watch;
  work();
  return watch.seconds();
}

check::Use use_of(const TrainSettings& settings, const TrainOptions& options) {
  check::Use use = training_use(settings);
  if (options.lpips.wanted()) use.parts.push_back(check::Part::networks);
  return use;
}

// Does the work from the last iteration to the end of the run; `write` writes all results. This work may fail
// because the disk is full, or the process may be killed. As long as there is a checkpoint, `ubs train
// --resume` writes the results again, so the last step is to rename the checkpoint to continue.ubs. The
// finished run can be continued from that file. If the run was completed early, continue.ubs contains the
// state from before the cool-down, and the last step removes the checkpoint.
void finish(RunFolder& folder, RunKeeper& keeper, const Trainer& trainer, const TrainSettings& settings,
            const std::function<void()>& write) {
  const auto& early = trainer.completed_from();
  const bool keeps_early = early && keeper.saved_iteration() == early->iteration;
  if (keeps_early) folder.keep_checkpoint();
  const RunInterval interval = checkpoint_interval(settings);
  if (interval.iterations > 0 || interval.seconds > 0) keeper.save(trainer.state(), settings);
  try {
    write();
    folder.sync_log();
  } catch (const std::exception& exception) {
    if (keeper.saved_iteration() < 0) throw;
    const Error error = as_error(exception);
    throw Error(error.kind(),
                fmt::format("{}; resume from iteration {} with 'ubs train --resume {}' to write the results",
                            error.what(), keeper.saved_iteration(), shell_word(folder.path().string())));
  }
  if (keeps_early)
    folder.remove_checkpoint();
  else
    folder.keep_checkpoint();
}

// Compiles the kernels for this rank's share of the splats; other ranks have the rest.
void build_kernels_of_rank(Device& device, TrainSettings settings, const Split& train, const Split& test,
                           const SplatModel& initial, ImageMetrics* networks) {
  const auto all = static_cast<std::uint32_t>(initial.count);
  const std::uint32_t own = largest_share(all, ranks().size());
  settings.cap_max =
      static_cast<int>(largest_share(static_cast<std::uint32_t>(settings.cap_max), ranks().size()));
  build_kernels(device, settings, train, test, own == all ? initial : part_of(initial, {0, own}), networks);
}

// Assigns more views to ranks with faster devices. The speeds measured at the start of a run are used for the
// whole run.
std::vector<std::uint64_t> deal_by_speed(const Start& start, Device& device, const Split& train,
                                         const SplatModel& initial) {
  const auto size = static_cast<std::size_t>(ranks().size());
  if (start.checkpoint && start.checkpoint->views_by_rank.size() == size)
    return start.checkpoint->views_by_rank;
  std::vector<float> speeds(size);
  speeds[static_cast<std::size_t>(ranks().rank())] =
      static_cast<float>(1 / view_seconds(device, in_unit(start.settings), train, initial));
  ranks().merge(speeds);
  const std::vector<double> measured(speeds.begin(), speeds.end());
  return Deal(static_cast<std::uint64_t>(start.settings.batch), ranks().size(), measured).counts();
}

// Throws Error(usage) for options that a run of several ranks does not support. With --budget,
// all ranks would have to measure the same speed, but each machine has its own clock. --serve would require
// that one rank has the complete model to show it to viewers.
void check_shared(const TrainOptions& options) {
  if (!options.start.budget.empty())
    fail(ErrorKind::usage, "--budget is not supported with several MPI processes: use --iterations");
  if (options.serve.option().count() > 0)
    fail(ErrorKind::usage, "--serve is not supported with several MPI processes: remove it");
}

int print_settings(const TrainOptions& options) {
  TrainSettings settings = options.settings.resolve();
  const std::vector<FieldValue> fields = bind_fields(settings, train_fields());
  if (options.json)
    print_json(to_json(fields));
  else
    say("{}", to_yaml(fields));
  return 0;
}

// Returns the keys of the settings that were chosen from the data.
Json changed_keys(TrainSettings asked, TrainSettings settled) {
  const std::vector<FieldValue> before = bind_fields(asked, train_fields()),
                                after = bind_fields(settled, train_fields());
  Json keys = Json::array();
  for (std::size_t i = 0; i < before.size(); ++i)
    if (field_text(before[i]) != field_text(after[i])) keys.push_back(before[i].key);
  return keys;
}

int run(const TrainOptions& options) {
  const Stopwatch since_start;
  if (options.print_settings) return print_settings(options);
  files_before_output();
  const LpipsRequest lpips = options.lpips.request();
  Start start = start_of(options.start, options.settings, ranks().first());
  if (ranks().size() > 1) check_shared(options);
  TrainSettings& settings = start.settings;
  RunFolder folder(start.out, ranks().first());
  const bool overwrite = options.start.overwrite || start.checkpoint;
  folder.check_files(overwrite);
  const std::unique_ptr<serve::Server> server = options.serve.open();
  std::optional<EndOnRequest> beforehand(
      "\nubs: interrupted before the first iteration; nothing was written\n");
  // Rejects a missing device now, because reading the data may take minutes.
  choose_device(list_devices(), device_of_rank(options.device));
  if (options.talkative()) log_line(LogLevel::notice, fmt::format("reading {}", start.data));
  Dataset data = open_dataset(start.data, {"train", "test"}, settings, Images::load);
  const TrainSettings asked = settings;
  const Split* const given = data.find("train");
  const std::uint32_t data_print = given ? fingerprint(*given) : 0;  // before cameras are aligned
  if (options.talkative() && given && !start.checkpoint)
    log_line(LogLevel::notice,
             fmt::format("choosing settings and initial points from {} images", given->views.size()));
  Split train_split = take_train(data, settings, !start.checkpoint);
  const Json chosen = changed_keys(asked, settings);
  Split test_split = take_test(data, settings);
  folder.check_renders(test_split, settings.save_renders, overwrite);
  for (const Split* split : {&train_split, &test_split}) folder.check_apart_from(*split);
  std::unique_ptr<Device> device;
  const double proof_seconds = seconds_of(
      [&] { device = open_proved_device(device_of_rank(options.device), use_of(settings, options)); });
  std::unique_ptr<ImageMetrics> networks;
  if (options.lpips.wanted()) networks = open_networks(*device, lpips, test_split);
  if (options.talkative()) print_start(data, train_split, test_split, settings, *device);
  if (options.talkative() && options.start.out.empty() && !start.checkpoint)
    say("output   {} (choose another folder with --out)\n", start.out);
  const std::vector<Camera> given_cameras = cameras_of(train_split);
  divide_by_unit(data, std::array{&train_split, &test_split}, settings.unit);
  Checkpoint run = identity(settings, std::filesystem::absolute(start.data).lexically_normal().string(),
                            data_print, *device);
  const int device_kinds = join_run(ranks(), run);
  if (start.checkpoint) check_same_run(*start.checkpoint, run, options.start.any_device);
  double build_seconds = 0;
  const auto warm_up = [&](const TrainSettings& with, const SplatModel& initial) {
    build_seconds += seconds_of(
        [&] { build_kernels_of_rank(*device, with, train_split, test_split, initial, networks.get()); });
  };
  // The time of checking the device and of compiling kernels does not count, because the results are stored
  // for later runs.
  const auto spent = [&] { return since_start.seconds() - proof_seconds - build_seconds; };
  run.budget = start.checkpoint ? start.checkpoint->budget
               : start.fast     ? choose_settings(options, start, *device, data, train_split, warm_up, spent)
                                : TimeBudget{};
  if (start.checkpoint && !options.start.budget.empty())
    settings.work_shares = shares_until(settings, start.checkpoint->state.iteration);
  const SplatModel initial =
      start.checkpoint ? start.checkpoint->state.model : initial_model(data, train_split, in_unit(settings));
  warm_up(settings, initial);
  if (options.talkative())
    say("kernels  compiled in {:.1f} s (not part of a time budget)\n{} {} splats\n", build_seconds,
        start.checkpoint ? "state   " : "begins  ", initial.count);
  flush_out();
  networks.reset();  // its memory does not count as that of training
  device->reset_peak();
  Trainer trainer(*device, in_unit(settings), train_split, test_split, initial, ranks());
  if (device_kinds > 1) {
    run.views_by_rank = deal_by_speed(start, *device, train_split, initial);
    trainer.scene().shared()->deal_views(run.views_by_rank);
  }
  // From here on, files are changed, so signals are handled until the end. A signal after the last step does
  // not stop the writing of the results.
  beforehand.reset();
  InterruptGuard guard(ranks().size() == 1);
  begin(start, folder, trainer, options.talkative());
  const double preparation = since_start.seconds();
  if (run.budget.seconds > 0) {
    if (!start.checkpoint) run.budget.spent = spent();
    trainer.keep_to(run.budget);
  }
  if (start.checkpoint && !options.start.budget.empty() && start.checkpoint->is_finished())
    trainer.go_on_for(run.budget.seconds - trainer.seconds());
  if (!settings.chosen.contains("eval_every")) trainer.sample_test();
  const double budget_seconds = run.budget.seconds, budget_spent = run.budget.spent;
  RunKeeper keeper(folder, std::move(run), start.checkpoint ? trainer.iteration() : -1);
  Progress progress(settings.iterations, options.quiet || !ranks().first());
  std::optional<serve::LiveTraining> live;
  if (server) {
    SplatModel model = initial;
    scale_lengths(model, settings.unit);
    live.emplace(*server, options.serve_share, *device, trainer, settings,
                 served_scene(start.out, model, in_unit(train_split, 1 / settings.unit), true));
  }
  Outcome outcome =
      train_and_keep(trainer, folder, keeper, progress, guard, settings, live ? &*live : nullptr);
  guard.loop_ended();
  take_pace(trainer, settings);

  const Background::Learnt learnt = settings.background.learnt;
  std::uint64_t peak_bytes = 0;
  Json json;
  std::size_t renders = 0;
  const auto write_results = [&] {
    TrainSettings drawn = settings;
    drawn.background = trainer.scene().drawn_settings().background;
    folder.write_config(settings);
    SplatModel model = trainer.model();
    scale_lengths(model, settings.unit);
    folder.save_model(model, model_comments(data, drawn, given_cameras));
    measure_end(trainer, test_split, outcome);
    peak_bytes = device->peak_bytes();
    std::vector<double> differences;
    if (device_kinds > 1) differences = trainer.scene().shared()->picture_differences(0);
    if (options.lpips.wanted()) measure_finally(*device, lpips, trainer, outcome);
    if (!outcome.interrupted && outcome.evaluation && ranks().size() == 1)
      outcome.train = trainer.scene().evaluate_train(kMeasuredTrainViews);
    if (ranks().first()) {
      json = run_json(start, *device, peak_bytes, budget_spent, trainer, outcome);
      json["kernel_seconds"] = build_seconds;
      json["preparation_seconds"] = preparation;
      if (!chosen.empty()) json["chosen"] = chosen;
      if (learnt != Background::Learnt::no) json["learnt_background"] = to_string(drawn.background);
      json["storage_bytes"] = std::filesystem::file_size(folder.model());
      json["data_report"] = report_json(data.report);
      json["offset"] = data.offset;
      json["data_print"] = data_print;
      if (device_kinds > 1) json["picture_differences_by_rank"] = differences;
      json["renders"] = outcome.interrupted ? std::vector<std::string>{}
                                            : RunFolder::render_names(test_split, settings.save_renders);
      json["budget_seconds"] = budget_seconds > 0 ? Json(budget_seconds) : Json();
      folder.save_metrics(json);
    }
    folder.save_cameras(trainer, train_split, test_split, data, settings.unit, !outcome.interrupted);
    if (!outcome.interrupted) renders = folder.save_renders(trainer, test_split, settings.save_renders);
  };
  if (outcome.interrupted)
    write_results();
  else
    finish(folder, keeper, trainer, settings, write_results);
  if (live && !guard.must_end()) live->end();
  if (options.json) print_json(json);
  if (options.talkative()) {
    print_summary(start, folder, trainer, outcome, peak_bytes, renders);
    if (learnt != Background::Learnt::no)
      say("trained  background {}{}\n", fmt::join(trainer.scene().drawn_settings().background.colour, ","),
          learnt == Background::Learnt::sky ? " (average over all directions)" : "");
    if (live) say("live     {}\n", live->summary());
  }
  // In a job, all ranks must return the same code. So a signal that reached only one of them after the last
  // step does not change the code.
  const bool interrupted = ranks().size() > 1 ? outcome.interrupted : guard.interrupted();
  // The results are complete, so a signal from here on only closes the page. A batch job ends at once.
  if (live && !interrupted && options.talkative() && in_foreground() && live->has_viewer()) {
    flush_out();
    remark("ubs: the page shows the final model until it is closed, or until Ctrl-C\n");
    live->stay([&] { return guard.interrupted(); });
  }
  return interrupted ? kInterruptedExitCode : 0;
}

}  // namespace

Command add_train(CLI::App& root) {
  CLI::App* app = root.add_subcommand("train", "Train a model on a data set");
  const auto options = std::make_shared<TrainOptions>(*app);
  app->add_option("data,--data", options->start.data,
                  fmt::format("data folder ({}; docs/data.md) or packed file", layout_titles()))
      ->type_name("DIR|FILE");
  app->get_option("--dim")->description(kAutoDimHelp);
  app->add_option("--out", options->start.out,
                  "output folder: model.ply, metrics.json, log.csv, config.yaml, checkpoint.ubs, renders/ "
                  "[next to the data: NAME-ubs, NAME-ubs-2, ...]")
      ->type_name("DIR");
  app->add_option(
         "--budget", options->start.budget,
         fmt::format(
             "train for this time, such as 90s, 10m or 1h; ubs chooses iterations, splats and growth to fit "
             "(docs/budget.md) [without --iterations: {} iterations or 15m, whichever ends first]; with "
             "--resume, +TIME is the time for the rest of the run",
             kDefaultIterations))
      ->type_name("TIME");
  app->add_option("--resume", options->start.resume,
                  "resume the interrupted run in this output folder with its data and settings; with "
                  "--budget +TIME also a finished run")
      ->type_name("DIR");
  app->add_flag("--any-device", options->start.any_device,
                "with --resume: allow a different device; results will not be bit-identical")
      ->needs("--resume")
      ->group(kRareGroup);
  add_overwrite_option(*app, options->start.overwrite);
  app->add_flag("--print-settings", options->print_settings,
                "print all settings instead of training, as a file for --spec, or with --json as JSON; "
                "settings that you do not pass have their published values")
      ->group(kRareGroup);
  add_device_option(*app, options->device);
  app->add_option("--serve-share", options->serve_share,
                  "percentage of the training time that --serve may use for rendering [5]")
      ->needs(&options->serve.option())
      ->check(from_to(0.1, 100.0))
      ->type_name("PERCENT");
  app->add_flag("--quiet", options->quiet, "print errors and warnings only");
  app->add_flag("--json", options->json, "print metrics.json instead of the summary");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
