// SPDX-License-Identifier: Apache-2.0
// ubs train: trains a model on a data folder and writes it with its measurements to an output folder.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/base/text.hpp"
#include "host/base/warning.hpp"
#include "host/device/registry.hpp"
#include "host/look/serve/live.hpp"
#include "host/run/open_data.hpp"
#include "host/run/same_run.hpp"
#include "host/run/training_run.hpp"
#include "host/run/verified_device.hpp"
#include "host/scene/doubles.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/settings/fields.hpp"
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
#include "tools/common/run_writer.hpp"
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
Outcome train_and_keep(Trainer& trainer, RunFolder& folder, RunWriter& keeper, Progress& progress,
                       const InterruptGuard& guard, serve::LiveTraining* live) {
  const RunInterval interval = checkpoint_interval(trainer.settings());
  const auto save = [&](const auto& state) {  // of the trainer, or the trainer itself
    return keeper.save(state, trainer.plan().recorded());
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
    Outcome outcome = train(trainer, folder, progress, guard, live);
    if (outcome.interrupted && !keeps_start()) outcome.saved = save(trainer);
    return outcome;
  } catch (const std::exception& exception) {
    const Error error = as_error(exception);
    progress.finish();
    if (ranks().size() > 1) throw;  // other ranks do not know about the exception
    try {
      if (trainer.state_is_consistent() && trainer.iteration() > 0 && !keeps_start()) save(trainer);
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

// Prints the length of a run whose number of iterations was chosen automatically.
void say_schedule(const TrainingRun& run, const TimeBudget& budget, bool asked) {
  const TrainSettings settings = run.plan().settings();
  const bool ends_early = budget.seconds > 0 && settings.iterations < budget.most_iterations;
  say("schedule {}{} iterations{}, at most {} splats\n", ends_early ? "about " : "", settings.iterations,
      budget.seconds > 0
          ? fmt::format(" in the {} that are left of {}", duration_text(budget.seconds - budget.spent),
                        duration_text(budget.seconds))
          : "",
      settings.cap_max);
  if (!asked)
    say("         (--budget TIME or --iterations N for another length; --schedule published for the "
        "published "
        "rates)\n");
  if (const std::string sizes = sizes_text(pyramid_levels(settings, run.train())); !sizes.empty())
    say("images   {}\n", sizes);
  flush_out();
}

// Prepares the folder for a new run. For a resumed run, restores the state of the trainer and continues the
// log.
void begin(const Start& start, RunFolder& folder, Trainer& trainer, bool talkative) {
  const TrainSettings settings = trainer.plan().recorded();
  if (!start.checkpoint) return folder.begin(settings);
  trainer.restore(start.checkpoint->state);
  folder.resume(settings, trainer.iteration());
  if (talkative) say("resumed  at iteration {}, {:.1f} s\n", trainer.iteration(), trainer.seconds());
}

template <typename Work>
double seconds_of(Work work) {
  const Stopwatch watch;
  work();
  return watch.seconds();
}

check::Use use_of(const TrainingRun& run, const TrainOptions& options) {
  check::Use use = run.use();
  if (options.lpips.wanted()) use.parts.push_back(check::Part::networks);
  return use;
}

// Does the work from the last iteration to the end of the run; `write` writes all results. This work may fail
// because the disk is full, or the process may be killed. As long as there is a checkpoint, `ubs train
// --resume` writes the results again, so the last step is to rename the checkpoint to continue.ubs. The
// finished run can be continued from that file. If the run was completed early, continue.ubs contains the
// state from before the cool-down, and the last step removes the checkpoint.
void finish(RunFolder& folder, RunWriter& keeper, const Trainer& trainer,
            const std::function<void()>& write) {
  const auto& early = trainer.completed_from();
  const bool keeps_early = early && keeper.saved_iteration() == early->iteration;
  if (keeps_early) folder.keep_checkpoint();
  const RunInterval interval = checkpoint_interval(trainer.settings());
  if (interval.iterations > 0 || interval.seconds > 0 || keeper.saved_iteration() >= 0)
    keeper.save(trainer, trainer.plan().recorded());
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
    keeper.finish(trainer.iteration());
}

// Assigns more views to ranks with faster devices. The speeds measured at the start of a run are used for the
// whole run.
std::vector<std::uint64_t> deal_by_speed(const Start& start, const TrainingRun& run, Device& device,
                                         const SplatModel& initial) {
  const auto size = static_cast<std::size_t>(ranks().size());
  if (start.checkpoint && start.checkpoint->views_by_rank.size() == size)
    return start.checkpoint->views_by_rank;
  std::vector<float> speeds(size);
  speeds[static_cast<std::size_t>(ranks().rank())] =
      static_cast<float>(1 / view_seconds(device, run.plan(), run.train(), initial));
  ranks().merge(speeds);
  const std::vector<double> measured(speeds.begin(), speeds.end());
  return ViewAssignment(static_cast<std::uint64_t>(run.plan().settings().batch), ranks().size(), measured)
      .counts();
}

// Throws Error(usage) for options that a run of several ranks does not support. With --budget,
// all ranks would have to measure the same speed, but each machine has its own clock. --serve would require
// that one rank has the complete model to show it to viewers.
void check_shared(const TrainOptions& options, const TrainSettings& settings) {
  if (settings.budget != "auto" && budget_seconds(settings) > 0)
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

int run(const TrainOptions& options) {
  const Stopwatch since_start;
  if (options.print_settings) return print_settings(options);
  files_before_output();
  const LpipsRequest lpips = options.lpips.request();
  Start start = start_of(options.start, options.settings, ranks().first());
  if (ranks().size() > 1) check_shared(options, start.settings);
  RunFolder folder(start.out, ranks().first(), start.lock.get());
  const bool resumes = start.checkpoint.has_value(), overwrite = options.start.overwrite || resumes;
  folder.check_files(overwrite);
  const std::unique_ptr<serve::Server> server = options.serve.open();
  std::optional<EndOnRequest> beforehand(
      "\nubs: interrupted before the first iteration; nothing was written\n");
  // Rejects a missing device now, because reading the data may take minutes.
  choose_device(list_devices(), device_of_rank(options.device));
  if (options.talkative()) log_line(LogLevel::notice, fmt::format("reading {}", start.data));
  auto data =
      std::make_shared<Dataset>(open_dataset(start.data, {"train", "test"}, start.settings, Images::load));
  if (const Split* given = data->find("train"); options.talkative() && given && !resumes)
    log_line(LogLevel::notice,
             fmt::format("choosing settings and initial points from {} images", given->views.size()));
  std::unique_ptr<Device> device;  // outlives the trainer of the run
  TrainingRun run(data, start.settings, !resumes);
  run.warn_about_test();
  folder.check_renders(run.test(), start.settings.save_renders, overwrite);
  for (const Split* split : {&run.train(), &run.test()}) folder.check_apart_from(*split);
  const double proof_seconds = seconds_of(
      [&] { device = open_verified_device(device_of_rank(options.device), use_of(run, options)); });
  std::unique_ptr<ImageMetrics> networks;
  if (options.lpips.wanted()) networks = open_networks(*device, lpips, run.test());
  if (options.talkative()) print_start(run, *device);
  if (options.talkative() && options.start.out.empty() && !resumes)
    say("output   {} (choose another folder with --out)\n", start.out);
  Checkpoint identified =
      identity(run.plan().recorded(), std::filesystem::absolute(start.data).lexically_normal().string(),
               run.data_print(), *device);
  const int device_kinds = join_run(ranks(), identified);
  if (resumes) check_same_run(*start.checkpoint, identified, options.start.any_device);
  double build_seconds = 0;
  const auto warm_up = [&](const Plan& plan, const SplatModel& initial) {
    build_seconds += seconds_of([&] { run.warm_up(*device, plan, initial, ranks(), networks.get()); });
  };
  // The time of checking the device and of compiling kernels does not count, because the results are stored
  // for later runs.
  const auto spent = [&] { return since_start.seconds() - proof_seconds - build_seconds; };
  const bool chooses_length = !resumes && run.time_limit() > 0;
  if (chooses_length && ranks().size() == 1) {
    if (options.talkative()) {
      say("steps    being measured, to choose the number of iterations\n");
      flush_out();
    }
    run.fit_to_budget(*device, warm_up, spent);
  }
  if (chooses_length && options.talkative())
    say_schedule(run, run.budget_from(spent()), start.settings.budget != "auto");
  const SplatModel initial = resumes ? start.checkpoint->state.model : run.initial();
  warm_up(run.plan(), initial);
  if (options.talkative())
    say("kernels  compiled in {:.1f} s (not part of a time budget)\n{} {} splats\n", build_seconds,
        resumes ? "state   " : "begins  ", initial.count);
  flush_out();
  networks.reset();  // its memory does not count as that of training
  device->reset_peak();
  Trainer& trainer = run.start(*device, initial, ranks());
  if (device_kinds > 1) {
    identified.views_by_rank = deal_by_speed(start, run, *device, initial);
    trainer.scene().shared()->assign_views(identified.views_by_rank);
  }
  // From here on, files are changed, so signals are handled until the end. A signal after the last step does
  // not stop the writing of the results.
  beforehand.reset();
  InterruptGuard guard(ranks().size() == 1);
  begin(start, folder, trainer, options.talkative());
  const double preparation = since_start.seconds();
  identified.budget = resumes ? start.checkpoint->budget : run.budget_from(spent());
  const TimeBudget& budget = identified.budget;
  const double budget_seconds = budget.seconds, budget_spent = budget.spent;
  if (budget.seconds > 0) trainer.keep_to(budget);
  if (start.has_more_time && start.checkpoint->is_finished())
    trainer.go_on_for(budget.seconds - trainer.seconds());
  if (!start.settings.chosen.contains("eval_every")) trainer.sample_test();
  RunWriter keeper(folder, std::move(identified), resumes ? trainer.iteration() : -1);
  Progress progress(trainer.settings().iterations, options.quiet || !ranks().first());
  std::optional<serve::LiveTraining> live;
  if (server) {
    SplatModel model = initial;
    scale_lengths(model, run.plan().unit());
    live.emplace(*server, options.serve_share, *device, trainer, run.plan().recorded(),
                 served_scene(start.out, model, in_unit(run.train(), 1 / run.plan().unit()), true));
  }
  Outcome outcome = train_and_keep(trainer, folder, keeper, progress, guard, live ? &*live : nullptr);
  guard.loop_ended();

  const Background::Learnt learnt = trainer.settings().background.learnt;
  std::uint64_t peak_bytes = 0;
  Json json;
  std::size_t renders = 0;
  const auto write_results = [&] {
    folder.write_config(run.plan().recorded());
    const SplatModel model = run.model();
    folder.save_model(model, run.comments());
    measure_end(trainer, run.test(), outcome);
    peak_bytes = device->peak_bytes();
    std::vector<double> differences;
    if (device_kinds > 1) differences = trainer.scene().shared()->picture_differences(0);
    if (options.lpips.wanted()) measure_finally(*device, lpips, trainer, outcome);
    if (!outcome.interrupted && outcome.evaluation && ranks().size() == 1)
      outcome.train = trainer.scene().evaluate_train(kMeasuredTrainViews);
    if (ranks().first()) {
      json = run_json(start, run, *device, peak_bytes, budget_spent, outcome);
      json["kernel_seconds"] = build_seconds;
      json["preparation_seconds"] = preparation;
      if (!run.chosen().empty()) json["chosen"] = run.chosen();
      if (learnt != Background::Learnt::no)
        json["learnt_background"] = to_string(run.settings_with_learnt_background().background);
      json["doubles"] = share_of_doubles(model);
      json["storage_bytes"] = std::filesystem::file_size(folder.model());
      json["data_report"] = report_json(run.report());
      json["offset"] = run.offset();
      json["data_print"] = run.data_print();
      if (device_kinds > 1) json["picture_differences_by_rank"] = differences;
      json["renders"] = outcome.interrupted
                            ? std::vector<std::string>{}
                            : RunFolder::render_names(run.test(), start.settings.save_renders);
      json["budget_seconds"] = budget_seconds > 0 ? Json(budget_seconds) : Json();
      folder.save_metrics(json);
    }
    folder.save_cameras(run, !outcome.interrupted);
    if (!outcome.interrupted) renders = folder.save_renders(trainer, run.test(), start.settings.save_renders);
  };
  if (outcome.interrupted)
    write_results();
  else
    finish(folder, keeper, trainer, write_results);
  if (live && !guard.must_end()) live->end();
  if (options.json) print_json(json);
  if (options.talkative()) {
    print_summary(start, folder, trainer, outcome, peak_bytes, renders);
    if (learnt != Background::Learnt::no)
      say("trained  background {}{}\n",
          fmt::join(trainer.scene().settings_with_learnt_background().background.colour, ","),
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
  app->add_option("--out", options->start.out,
                  "output folder: model.ply, metrics.json, log.csv, config.yaml, checkpoint.ubs, renders/ "
                  "[next to the data: NAME-ubs, NAME-ubs-2, ...]")
      ->type_name("DIR");
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
                "the data determine those that are auto")
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
