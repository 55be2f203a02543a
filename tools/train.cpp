// SPDX-License-Identifier: Apache-2.0
// ubs train: learns a model from a data folder and leaves it with its measurements in an output folder.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>

#include "host/base/error.hpp"
#include "host/data/foreign_formats.hpp"
#include "host/spec/settings.hpp"
#include "host/train/trainer.hpp"
#include "tools/commands.hpp"
#include "tools/common/dataset.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/lpips_options.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/output.hpp"
#include "tools/common/plan_text.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/run_folder.hpp"
#include "tools/common/run_keeper.hpp"
#include "tools/common/training_data.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

struct Options {
  explicit Options(CLI::App& app) : settings(app), lpips(app) {}
  SettingsOptions settings;
  LpipsOptions lpips;
  std::string data, out, resume, device;
  bool quiet = false, json = false, overwrite = false, any_device = false, no_plan = false;
};

constexpr int kFewestPlannedIterations = 1000;  // a plan costs as much as ten to a hundred

// What a run is made of: from the options, or from the checkpoint of the run that is continued.
struct Start {
  std::string data, out;
  TrainSettings settings;
  std::optional<Checkpoint> checkpoint;
};

Start start_of(const Options& options) {
  if (options.resume.empty()) {
    for (const auto& [name, value] : {std::pair{"--data", &options.data}, {"--out", &options.out}})
      if (value->empty()) fail(ErrorKind::usage, "{} is required (see 'ubs train --help')", name);
    return {options.data, options.out, options.settings.resolve(), {}};
  }
  if (!options.out.empty() || options.overwrite)
    fail(ErrorKind::usage, "--resume goes on in the folder of the run: leave out --out and --overwrite");
  Checkpoint checkpoint = open_checkpoint(options.resume);
  const TrainSettings settings = options.settings.resolve(checkpoint.settings);
  check_same_settings(checkpoint.settings, settings);
  return {options.data.empty() ? checkpoint.data : options.data, options.resume, settings, std::move(checkpoint)};
}

// What a checkpoint of this run says, but for its state.
Checkpoint identity(const Start& start, const Split& train, const Device& device) {
  Checkpoint run;
  run.settings = start.settings;
  run.data = std::filesystem::absolute(start.data).lexically_normal().string();
  run.data_print = fingerprint(train);
  run.device = device_text(device.info());
  run.build = build_id();
  if (start.checkpoint) run.planned_seconds = start.checkpoint->planned_seconds;
  return run;
}

void check_same_run(const Checkpoint& before, const Checkpoint& now, bool any_device) {
  if (before.data_print != now.data_print)
    fail(ErrorKind::data, "{}: cameras, names or images are not those that the run was started with ({})", now.data,
         before.data);
  if (before.device != now.device && !any_device)
    fail(ErrorKind::data,
         "the run was started on '{}', this is '{}': its results would not be the same bits; choose that device with "
         "--device, or go on all the same with --any-device",
         before.device, now.device);
  if (before.build != now.build)
    warn("the run was started by another build of this program; its results may differ from an uninterrupted run");
}

struct Evaluation {
  int iteration = 0;
  double seconds = 0;
  Metrics metrics;
};

struct Outcome {
  bool interrupted = false;
  std::optional<Evaluation> evaluation;  // the last one
};

Outcome train(Trainer& trainer, RunFolder& folder, Progress& progress, int iterations) {
  Outcome outcome;
  const InterruptGuard guard;
  trainer.run([&](const StepReport& report) {
    if (report.loss) {
      folder.log(report);
      progress.update(report);
    }
    if (report.test) outcome.evaluation = {report.iteration, report.seconds, *report.test};
    outcome.interrupted = guard.interrupted() && report.iteration < iterations;
    return !outcome.interrupted;
  });
  progress.finish();
  return outcome;
}

// As train(); after an error that leaves the state whole (an image that cannot be read, no memory) it is kept.
Outcome train_and_keep(Trainer& trainer, RunFolder& folder, RunKeeper& keeper, Progress& progress,
                       const TrainSettings& settings) {
  const CheckpointInterval interval = checkpoint_interval(settings);
  trainer.on_state({interval.iterations, interval.seconds, [&](const TrainState& state) { keeper.save(state); }});
  trainer.on_nonfinite([&](const NonFiniteEvent& event) {
    progress.finish();
    keeper.report(event, "train");
  });
  try {
    const Outcome outcome = train(trainer, folder, progress, settings.iterations);
    if (outcome.interrupted) keeper.save(trainer.state());
    return outcome;
  } catch (const Error& error) {
    progress.finish();
    try {
      if (trainer.state_is_whole() && trainer.iteration() > 0) keeper.save(trainer.state());
    } catch (const Error&) {  // the device is gone: the first error says why
    }
    if (keeper.saved_iteration() < 0) throw;
    throw Error(error.kind(), fmt::format("{}; the state of iteration {} is kept: ubs train --resume {}", error.what(),
                                          keeper.saved_iteration(), folder.model().parent_path().string()));
  }
}

RunFigures actual_figures(Trainer& trainer, const Device& device) {
  return {trainer.seconds(), 1e3 * trainer.seconds() / std::max(1, trainer.iteration()), trainer.intersections().mean(),
          trainer.intersections().most, device.peak_bytes()};
}

// Finds out before hours of training whether the networks can be had and take the test images. Their memory is
// given back: it is no part of training's.
void check_lpips(Device& device, const LpipsRequest& request, const Split& test) {
  const ImageMetrics metrics(device, request);
  for (const View& view : test.views) metrics.check_size({view.camera.width, view.camera.height});
}

// The last evaluation again, with what training itself does not measure.
void measure_finally(Device& device, const LpipsRequest& request, Trainer& trainer, Outcome& outcome) {
  if (outcome.interrupted || !outcome.evaluation) return;
  ImageMetrics more(device, request);
  outcome.evaluation->metrics = trainer.evaluate_test(&more);
}

// Minutes by stage are estimates from sampled iterations (host/train/timed_stages.hpp); "other" is the rest:
// images, the host, what runs between stages.
Json minutes_json(const Trainer& trainer) {
  Json stages = Json::object();
  double known = 0;
  std::uint64_t samples = 0;
  for (const StageTime& time : trainer.stage_times()) {
    stages[std::string(time.stage)] = time.seconds / 60;
    known += time.seconds;
    if (time.stage == "raster_forward") samples = time.sampled;
  }
  stages["other"] = std::max(0.0, trainer.seconds() - known) / 60;
  return {{"total", trainer.seconds() / 60}, {"sampled_views", samples}, {"stages", std::move(stages)}};
}

Json run_json(const Start& start, const Device& device, std::uint64_t peak_bytes, Trainer& trainer, const Outcome& outcome) {
  TrainSettings settings = start.settings;
  Json json{{"version", version()},
            {"build", build_id()},
            {"data", start.data},
            {"interrupted", outcome.interrupted},
            {"dim", settings.dim},
            {"splats", trainer.device_model().count()},
            {"iterations", trainer.iteration()},
            {"seconds", trainer.seconds()},
            {"minutes", minutes_json(trainer)},
            {"resumed_from", nullptr},
            {"rollbacks", trainer.rollbacks()},
            {"dropped_splats", trainer.dropped()},
            {"peak_device_bytes", peak_bytes},
            {"predicted_device_bytes", trainer.memory_plan().total()},
            {"extent", trainer.extent()},
            {"device", device_json(device.info())},
            {"settings", to_json(bind_fields(settings, train_fields()))},
            {"test", nullptr}};
  if (start.checkpoint) json["resumed_from"] = start.checkpoint->state.iteration;
  if (const auto& evaluation = outcome.evaluation) {
    json["test"] = {{"iteration", evaluation->iteration}, {"seconds", evaluation->seconds}};
    json["test"].update(metrics_json(evaluation->metrics));
  }
  return json;
}

void print_summary(const Start& start, const RunFolder& folder, Trainer& trainer, const Outcome& outcome,
                   std::uint64_t peak_bytes, std::size_t renders) {
  fmt::print("{} after {} iterations, {:.1f} s: {} splats\n",
             outcome.interrupted ? "interrupted" : "finished", trainer.iteration(), trainer.seconds(),
             trainer.device_model().count());
  if (outcome.evaluation) fmt::print("test     {}\n", metrics_text(outcome.evaluation->metrics.mean));
  fmt::print("memory   {}, peak {:.1f} MiB\n", summary(trainer.memory_plan()),
             static_cast<double>(peak_bytes) / (1 << 20));
  fmt::print("model    {}\nmetrics  {}\n", folder.model().string(), folder.metrics().string());
  if (renders > 0) fmt::print("renders  {} (ground truth | render)\n", folder.renders().string());
  fmt::print("settings and log  {}\n", start.out);
  if (outcome.interrupted) fmt::print("go on with  ubs train --resume {}\n", start.out);
}

// The plan of a new run that is long enough for one; of a continued one, its seconds.
RunFigures planned_figures(const Options& options, const Start& start, Device& device, const Split& train,
                           const Split& test, const SplatModel& initial) {
  if (start.checkpoint) return {.seconds = start.checkpoint->planned_seconds};
  if (options.no_plan || start.settings.iterations < kFewestPlannedIterations) return {};
  const RunFigures figures = figures_of(plan_training(device, start.settings, train, test, initial, false));
  device.reset_peak();
  return figures;
}

void print_start(const Dataset& data, const Split& train, const Split& test, const TrainSettings& settings,
                 const Device& device) {
  print_report(data.report);
  const Camera& camera = train.views[0].camera;
  fmt::print("{} train and {} test views of {}x{}, N = {}\ndevice   {}\n", train.views.size(), test.views.size(),
             camera.width, camera.height, settings.dim, describe(device.info()));
  std::fflush(stdout);
}

int run(const Options& options) {
  Start start = start_of(options);
  TrainSettings& settings = start.settings;
  const LpipsRequest lpips = options.lpips.request();
  RunFolder folder(start.out, options.overwrite || start.checkpoint);
  const bool talkative = !options.quiet && !options.json;
  Dataset data = open_dataset(start.data, {"train", "test"}, settings, Images::load);
  const Split train_split = take_train(data, settings);
  const Split test_split = take_test(data, settings);
  const std::unique_ptr<Device> device = open_device(options.device);
  if (options.lpips.wanted()) check_lpips(*device, lpips, test_split);
  device->reset_peak();
  if (talkative) print_start(data, train_split, test_split, settings, *device);
  Checkpoint run = identity(start, train_split, *device);
  if (start.checkpoint) check_same_run(*start.checkpoint, run, options.any_device);
  const SplatModel initial =
      start.checkpoint ? start.checkpoint->state.model : initial_model(data, train_split, settings);
  const RunFigures planned = planned_figures(options, start, *device, train_split, test_split, initial);
  run.planned_seconds = planned.seconds;
  if (talkative && planned.step_ms > 0)
    fmt::print("plan     {:.1f} s, {:.2f} ms a step on average; memory {:.1f} MiB\n", planned.seconds, planned.step_ms,
               static_cast<double>(planned.memory_bytes) / (1 << 20));
  std::fflush(stdout);
  Trainer trainer(*device, settings, train_split, test_split, initial);
  if (start.checkpoint) {
    trainer.restore(start.checkpoint->state);
    folder.resume(settings, trainer.iteration());
    if (talkative) fmt::print("resumed  at iteration {}, {:.1f} s\n", trainer.iteration(), trainer.seconds());
  } else {
    folder.begin(settings);
  }
  std::vector<std::string> comments;
  if (data.offset != std::array<double, 3>{}) comments.push_back(make_offset_comment(data.offset));
  RunKeeper keeper(folder, std::move(run), comments, start.checkpoint ? trainer.iteration() : -1);
  Progress progress(settings.iterations, options.quiet);
  Outcome outcome = train_and_keep(trainer, folder, keeper, progress, settings);

  folder.save_model(trainer.model(), comments);
  const RunFigures actual = actual_figures(trainer, *device);
  if (options.lpips.wanted()) measure_finally(*device, lpips, trainer, outcome);
  Json json = run_json(start, *device, actual.memory_bytes, trainer, outcome);
  json["storage_bytes"] = std::filesystem::file_size(folder.model());
  json["data_report"] = report_json(data.report);
  json["offset"] = data.offset;
  json["planned"] = figures_json(planned);
  json["actual"] = figures_json(actual);
  folder.save_metrics(json);
  if (!outcome.interrupted) folder.remove_checkpoint();
  const std::size_t renders =
      outcome.interrupted ? 0 : folder.save_renders(trainer, test_split, settings.save_renders);
  if (options.json) print_json(json);
  if (talkative) {
    print_summary(start, folder, trainer, outcome, actual.memory_bytes, renders);
    if (!outcome.interrupted) fmt::print("{}", comparison_text(planned, actual));
  }
  return outcome.interrupted ? kInterruptedExitCode : 0;
}

}  // namespace

Command add_train(CLI::App& root) {
  CLI::App* app = root.add_subcommand("train", "Learn a model from a data set");
  const auto options = std::make_shared<Options>(*app);
  app->add_option("--data", options->data,
                  "data folder: Blender, D-NeRF, nerfstudio, COLMAP, LLFF or N3V (docs/data.md); or packed file")
      ->type_name("DIR|FILE");
  app->add_option("--out", options->out,
                  "output folder: model.ply, metrics.json, log.csv, config.yaml, checkpoint.ubs, renders/")
      ->type_name("DIR");
  app->add_option("--resume", options->resume,
                  "go on with the run in this output folder, which was interrupted, with the data and settings it has")
      ->type_name("DIR");
  app->add_flag("--any-device", options->any_device, "with --resume: also on another device (other bits)");
  app->add_flag("--no-plan", options->no_plan, "measure nothing before training (see 'ubs plan')");
  app->add_flag("--overwrite", options->overwrite, "replace the model in the output folder");
  add_device_option(*app, options->device);
  app->add_flag("--quiet", options->quiet, "print errors and warnings only");
  app->add_flag("--json", options->json, "print metrics.json instead of the summary");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
