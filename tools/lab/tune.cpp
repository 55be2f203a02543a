// SPDX-License-Identifier: Apache-2.0
// ubs-lab tune: finds the fastest values of a device's tuned constants and stores them for later runs.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/device/registry.hpp"
#include "host/device/tuning.hpp"
#include "host/lab/bench/bench_case.hpp"
#include "host/lab/bench/tune_subject.hpp"
#include "host/run/verified_device.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/program_version.hpp"
#include "tools/lab/bench_data.hpp"
#include "tools/lab/lab_commands.hpp"

namespace ubs::tools {
namespace {

struct TuneOptions {
  std::string device, raster = "auto", size, model, data, json;
  double max_seconds = 0;
  bool quick = false, dry_run = false, overwrite = false;
};

std::string verdict(const bench::Trial& trial) {
  if (!trial.note.empty()) return trial.note;
  return fmt::format("{:9.3f} ms, {:.3f} +- {:.3f} times the previous {:.3f} ms{}{}", trial.ms, trial.ratio,
                     trial.uncertainty, trial.before_ms,
                     trial.difference > 0 ? fmt::format(", results differ by {:.0e}", trial.difference) : "",
                     trial.kept ? "  <- kept" : "");
}

Json trial_json(const bench::Trial& t) {
  Json json{{"constant", t.macro}, {"value", t.value}, {"kept", t.kept}};
  if (!t.note.empty()) {
    json["note"] = t.note;
    return json;
  }
  json.update({{"before_ms", t.before_ms},
               {"ms", t.ms},
               {"ratio", t.ratio},
               {"uncertainty", t.uncertainty},
               {"difference", t.difference}});
  return json;
}

bench::BenchScene scene_of(const TuneOptions& options, const DeviceInfo& device) {
  if (!options.model.empty()) {
    std::string data = options.data;
    TrainSettings reading;
    const RunData run = use_run_data(options.model, data, {});
    read_as(reading, run);
    bench::BenchScene scene = open_bench_model(options.model, data, reading, run.opened);
    if (scene.mixed.mixed())
      fail(ErrorKind::usage,
           "{}: the model has splats of different dimensions and cannot be trained: choose another model",
           options.model);
    return scene;
  }
  if (!options.data.empty())
    fail(ErrorKind::usage, "--data requires --model: the model is rendered with the cameras of --data");
  if (options.size.empty()) return bench::tuning_scene(device, options.quick);
  const bench::SceneSize size = bench::parse_scene_size(options.size);
  return bench::synthetic_object(6, size.splats, size.width, size.height, 1);
}

const TunableDevice& tunable(Device& device) {
  const TunableDevice* const found = device.tunable();
  if (!found) fail(ErrorKind::usage, "{} has nothing to tune", device.info().name);
  return *found;
}

void write_json(const TuneOptions& options, const DeviceInfo& device, const bench::BenchScene& scene,
                const TuningValues& values, Json trials) {
  const Camera& camera = scene.views.views.front().camera;
  const Json json{{"version", version()},      {"build", build_id()},           {"date", utc_date()},
                  {"command", command_line()}, {"device", device_json(device)}, {"splats", scene.model.count},
                  {"width", camera.width},     {"height", camera.height},       {"trials", std::move(trials)},
                  {"values", values}};
  write_file_atomically(options.json, json_file_text(json));
}

int run(const TuneOptions& options) {
  files_before_output();
  check_output_files({options.json}, {options.model}, options.overwrite);
  const std::unique_ptr<Device> device = open_verified_device(options.device, training_use({}));
  const RasterKind raster = raster_kind(options.raster, device->info());
  const TunedTable table = tunable(*device).tuned_constants();
  const std::string file = tuning_file(device->info()).string();
  if (file.empty() && !options.dry_run)
    fail(ErrorKind::usage, "no folder for the result: set UBS_TUNING_DIR, XDG_CACHE_HOME or HOME");
  const bench::BenchScene scene = scene_of(options, device->info());
  const Camera& camera = scene.views.views.front().camera;
  say("{}, kernels for {}, {} splats, {}x{}\n", describe(device->info()),
      raster == RasterKind::cpu ? "CPUs" : "GPUs", scene.model.count, camera.width, camera.height);
  flush_out();
  Json trials = Json::array();
  bench::TuneOptions tuning{.raster = raster, .quick = options.quick, .on_trial = {}};
  if (options.max_seconds > 0) tuning.max_seconds = options.max_seconds;
  int skipped = 0;
  tuning.on_trial = [&](const bench::Trial& trial) {
    skipped += trial.skipped ? 1 : 0;
    say("  {:<22} {:>5}  {}\n", trial.macro, trial.value, verdict(trial));
    flush_out();
    trials.push_back(trial_json(trial));
  };
  const TuningValues values = bench::tune(*device, scene, tuning);
  if (!options.json.empty()) write_json(options, device->info(), scene, values, std::move(trials));
  const auto constants =
      std::ranges::count_if(table, [&](const TunedConstant& c) { return c.raster == raster; });
  say("{} of {} constants differ from their defaults", values.size(), constants);
  for (const auto& [macro, value] : values) say(", {} = {}", macro, value);
  if (skipped > 0) say("; {} trials were skipped, because the time limit was reached", skipped);
  if (options.dry_run) {
    say("; not stored (--dry-run)\n");
  } else {
    save_tuning(device->info(), table, raster, values);
    say("; stored in {}\n", file);
  }
  return 0;
}

}  // namespace

Command add_tune(CLI::App& root) {
  const auto options = std::make_shared<TuneOptions>();
  CLI::App* app = root.add_subcommand(
      "tune", "Find the fastest values of the tuned constants on a device (docs/tuning.md)");
  add_device_option(*app, options->device);
  app->add_option("--raster", options->raster, "OpenCL kernels to tune: auto, cpu or gpu")
      ->check(CLI::IsMember({"auto", "cpu", "gpu"}))
      ->type_name("KIND");
  app->add_option(
         "--size", options->size,
         "image size and number of splats of the synthetic scene, such as 400x400/100K [chosen for the "
         "device]")
      ->type_name("WxH/SPLATS");
  add_model_option(*app, "model,--model", options->model,
                   "splat model or run folder to use instead of the synthetic scene")
      ->excludes("--size");
  app->add_option("data,--data", options->data, kRunDataHelp)->type_name("DIR|FILE");
  app->add_option("--max-time", options->max_seconds,
                  "start no further trial after this number of seconds [no limit]")
      ->check(positive())
      ->type_name("S");
  app->add_flag("--quick", options->quick,
                "use a small scene and few repetitions, to check that everything runs");
  app->add_flag("--dry-run", options->dry_run, "measure and print the result without storing it");
  app->add_option("--json", options->json, "write all trials to this file")->type_name("FILE");
  add_overwrite_option(*app, options->overwrite);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
