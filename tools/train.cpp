// SPDX-License-Identifier: Apache-2.0
// ubs train: learns a model from a data folder and leaves it with its measurements in an output folder.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>

#include "host/base/error.hpp"
#include "host/data/foreign_formats.hpp"
#include "host/scene/choose_dim.hpp"
#include "host/scene/frustum_points.hpp"
#include "host/scene/initialise.hpp"
#include "host/spec/settings.hpp"
#include "host/train/trainer.hpp"
#include "tools/commands.hpp"
#include "tools/common/dataset.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/output.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/run_folder.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

struct Options {
  explicit Options(CLI::App& app) : settings(app) {}
  SettingsOptions settings;
  std::string data, out, device;
  bool quiet = false, json = false, overwrite = false;
};

struct Evaluation {
  int iteration = 0;
  double seconds = 0;
  Metrics metrics;
};

struct Outcome {
  bool interrupted = false;
  std::optional<Evaluation> evaluation;  // the last one
};

// Fills in `--dim auto`; what it chose becomes part of the report.
Split take_train(Dataset& data, TrainSettings& settings) {
  Split train = take_split(data, "train");
  require_images(train);
  if (settings.dim == kAutoInt) {
    const DimChoice choice = choose_dim(train.views);
    settings.dim = choice.dim;
    validate(settings);
    data.report.notes.push_back(fmt::format("dim auto: N = {}, {}", choice.dim, choice.reason));
  }
  check_query(train, settings.dim);
  const auto same_time = [&](const View& view) { return view.camera.time == train.views[0].camera.time; };
  if (has_time(settings.dim) && std::ranges::all_of(train.views, same_time))
    warn(
        "all training views have the same time: N = {} learns nothing from it; for a static scene use --dim "
        "{}",
        settings.dim, settings.dim >= 6 ? 6 : 3);
  return train;
}

// The test split is optional, and so are its images: what cannot be measured is left out.
Split take_test(Dataset& data, const TrainSettings& settings) {
  if (!data.find("test")) {
    warn("{} has no test split: no measurements, no renders", data.report.folder);
    return {"test", {}};
  }
  Split test = take_split(data, "test");
  check_query(test, settings.dim);
  const std::size_t all = test.views.size();
  std::erase_if(test.views, [](const View& view) { return !view.has_image(); });
  if (test.views.size() < all)
    warn("{} of {} test views have no image and are left out", all - test.views.size(), all);
  return test;
}

// From the points of the data, else inside the stated depth bounds of the cameras, else in a box.
SplatModel initial_model(const Dataset& data, const Split& train, const TrainSettings& s) {
  InitOptions init;
  init.box = s.init_extent;
  init.variant = model_variant(s);
  init.beta = s.beta_init;
  if (s.beta_dir_init != kAuto) init.beta_dir = s.beta_dir_init;
  init.beta_query = s.beta_query_init;
  const auto points = static_cast<std::size_t>(s.init_points);
  if (data.points)
    return initialise_from_points(s.dim, data.points->positions, data.points->colours, s.seed, init);
  if (data.depth_bounds.size() == train.views.size()) {
    const PointCloud cloud = sample_frusta(train.views, data.depth_bounds, points, s.seed);
    return initialise_from_points(s.dim, cloud.positions, cloud.colours, s.seed, init);
  }
  return initialise_random(s.dim, points, s.seed, init);
}

Outcome train(Trainer& trainer, RunFolder& folder, Progress& progress) {
  Outcome outcome;
  const InterruptGuard guard;
  trainer.run([&](const StepReport& report) {
    if (report.loss) {
      folder.log(report);
      progress.update(report);
    }
    if (report.test) outcome.evaluation = {report.iteration, report.seconds, *report.test};
    outcome.interrupted = guard.interrupted();
    return !outcome.interrupted;
  });
  progress.finish();
  return outcome;
}

Json run_json(const Options& options, TrainSettings settings, const Device& device, Trainer& trainer,
              const Outcome& outcome) {
  Json json{{"version", version()},
            {"build", build_id()},
            {"data", options.data},
            {"interrupted", outcome.interrupted},
            {"dim", settings.dim},
            {"splats", trainer.device_model().count()},
            {"iterations", trainer.iteration()},
            {"seconds", trainer.seconds()},
            {"peak_device_bytes", device.peak_bytes()},
            {"predicted_device_bytes", trainer.memory_plan().total()},
            {"extent", trainer.extent()},
            {"device", device_json(device.info())},
            {"settings", to_json(bind_fields(settings, train_fields()))},
            {"test", nullptr}};
  if (const auto& evaluation = outcome.evaluation) {
    json["test"] = {{"iteration", evaluation->iteration}, {"seconds", evaluation->seconds}};
    json["test"].update(metrics_json(evaluation->metrics));
  }
  return json;
}

void print_summary(const Options& options, const RunFolder& folder, Trainer& trainer, const Outcome& outcome,
                   std::uint64_t peak_bytes, std::size_t renders) {
  fmt::print("{} after {} iterations, {:.1f} s: {} splats\n",
             outcome.interrupted ? "interrupted" : "finished", trainer.iteration(), trainer.seconds(),
             trainer.device_model().count());
  if (outcome.evaluation) fmt::print("test     {}\n", metrics_text(outcome.evaluation->metrics.mean));
  fmt::print("memory   {}, peak {:.1f} MiB\n", summary(trainer.memory_plan()),
             static_cast<double>(peak_bytes) / (1 << 20));
  fmt::print("model    {}\nmetrics  {}\n", folder.model().string(), folder.metrics().string());
  if (renders > 0) fmt::print("renders  {} (ground truth | render)\n", folder.renders().string());
  fmt::print("settings and log  {}\n", options.out);
}

int run(const Options& options) {
  TrainSettings settings = options.settings.resolve();
  RunFolder folder(options.out, options.overwrite);
  const bool talkative = !options.quiet && !options.json;
  Dataset data = open_dataset(options.data, {"train", "test"}, settings, Images::load);
  const Split train_split = take_train(data, settings);
  const Split test_split = take_test(data, settings);
  const std::unique_ptr<Device> device = open_device(options.device);
  if (talkative) {
    print_report(data.report);
    const Camera& camera = train_split.views[0].camera;
    fmt::print("{} train and {} test views of {}x{}, N = {}\ndevice   {}\n", train_split.views.size(),
               test_split.views.size(), camera.width, camera.height, settings.dim, describe(device->info()));
    std::fflush(stdout);
  }
  Trainer trainer(*device, settings, train_split, test_split, initial_model(data, train_split, settings));
  folder.begin(settings);
  Progress progress(settings.iterations, options.quiet);
  const Outcome outcome = train(trainer, folder, progress);

  std::vector<std::string> comments;
  if (data.offset != std::array<double, 3>{}) comments.push_back(make_offset_comment(data.offset));
  folder.save_model(trainer.model(), comments);
  Json json = run_json(options, settings, *device, trainer, outcome);
  json["data_report"] = report_json(data.report);
  json["offset"] = data.offset;
  folder.save_metrics(json);
  const std::uint64_t peak_bytes = device->peak_bytes();
  const std::size_t renders =
      outcome.interrupted ? 0 : folder.save_renders(trainer, test_split, settings.save_renders);
  if (options.json) print_json(json);
  if (talkative) print_summary(options, folder, trainer, outcome, peak_bytes, renders);
  return outcome.interrupted ? kInterruptedExitCode : 0;
}

}  // namespace

Command add_train(CLI::App& root) {
  CLI::App* app = root.add_subcommand("train", "Learn a model from a data set");
  const auto options = std::make_shared<Options>(*app);
  app->add_option("--data", options->data,
                  "data folder: Blender, D-NeRF, nerfstudio, COLMAP, LLFF or N3V (docs/data.md); or packed file")
      ->required()
      ->type_name("DIR|FILE");
  app->add_option("--out", options->out,
                  "output folder: model.ply, metrics.json, log.csv, config.yaml, renders/")
      ->required()
      ->type_name("DIR");
  app->add_flag("--overwrite", options->overwrite, "replace the model in the output folder");
  add_device_option(*app, options->device);
  app->add_flag("--quiet", options->quiet, "print errors and warnings only");
  app->add_flag("--json", options->json, "print metrics.json instead of the summary");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
