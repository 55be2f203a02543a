// SPDX-License-Identifier: Apache-2.0
// ubs-lab accuracy: measures the times of the kernels and their errors against float64, and writes a table.
// The table has a row for each combination of a configuration of the kernels, a scene and a device.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/dataset/synthetic.hpp"
#include "host/lab/accuracy/table.hpp"
#include "host/lab/bench/runner.hpp"
#include "host/run/open_data.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/program_version.hpp"
#include "tools/lab/lab_commands.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;
using namespace ubs::accuracy;

struct AccuracyOptions {
  explicit AccuracyOptions(CLI::App& app) : settings(app, drawing_keys({"lambda_dssim", "query_grad"})) {}
  SettingsOptions settings;
  std::vector<std::string> scenes, devices, configurations;
  std::string data, model, split = "test", out;
  std::size_t view = 0, splats = 10'000, rounds = 9;
  int size = 200, iterations = 300, dim = 6;
  bool quick = false, quiet = false, overwrite = false;
};

// Throws Error(usage) if a configuration contains a setting that has no effect on measure(). Only the
// settings of the variant and those in kMeasured have an effect.
void check_measured(const Configuration& c) {
  constexpr std::string_view kMeasured[] = {"math",         "alpha_min",  "raster",    "query_grad",
                                            "lambda_dssim", "near_plane", "far_plane", "eps2d"};
  for (const auto* part : {&c.settings, &c.truth})
    for (const std::string& assignment : *part) {
      const std::string key = assignment.substr(0, assignment.find('='));
      const bool of_kernels = part == &c.settings && std::ranges::count(kMeasured, key) > 0;
      if (!of_kernels && !variant_values(key))
        fail(ErrorKind::usage,
             "--config: {} of '{}' has no effect here: pass a setting of the variant "
             "(docs/variants.md){}{}",
             key, c.label, part == &c.settings ? " or one of " : "",
             part == &c.settings ? fmt::format("{}", fmt::join(kMeasured, ", ")) : "");
    }
}

// The default configuration always comes first, because the others are compared with it.
std::vector<Configuration> configurations(const AccuracyOptions& options) {
  std::vector<Configuration> all;
  for (const std::string& text : options.configurations) {
    all.push_back(parse_configuration(text));
    check_measured(all.back());
  }
  const std::vector<Configuration>& standard = standard_configurations();
  if (!all.empty()) {
    if (!all.front().settings.empty()) all.insert(all.begin(), standard.front());
    return all;
  }
  return options.quick ? std::vector(standard.begin(), standard.begin() + 2) : standard;
}

NamedScene embedded_scene(const AccuracyOptions& options, const std::string& name, Device& device) {
  bench::TrainedOptions trained{.dim = bench::scene_dim(name, options.dim),
                                .splats = options.splats,
                                .width = options.size,
                                .height = options.size,
                                .iterations = options.iterations};
  return {name, bench::trained_scene(device, name, trained), options.view, options.settings.resolve()};
}

NamedScene file_scene(const AccuracyOptions& options) {
  std::string data = options.data;
  const RunData run = use_run_data(options.model, data, options.settings.resolve());
  LoadedModel loaded = open_model(options.model);
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, run);
  Split split = open_split_for(loaded.offset, data, options.split, settings, Images::load, run.opened);
  require_images(split);
  const SplatModel& model = loaded.model.single("ubs-lab accuracy");
  check_query(split, model.dim);
  bench::BenchScene scene{model, std::move(split), {}};
  for (std::size_t c = 0; c < 3; ++c) scene.background[c] = static_cast<float>(settings.background.colour[c]);
  return {fs::path(options.model).filename().string(), std::move(scene), options.view, settings};
}

std::vector<NamedScene> load_scenes(const AccuracyOptions& options, Device& device) {
  std::vector<NamedScene> scenes;
  if (options.model.empty() && !options.data.empty())
    fail(ErrorKind::usage, "--data requires --model: the model is compared with the images of --data");
  if (!options.model.empty()) scenes.push_back(file_scene(options));
  std::vector<std::string> names = options.scenes;
  if (names.empty() && scenes.empty())
    names = options.quick ? std::vector<std::string>{"glossy"} : synthetic_scene_names();
  for (const std::string& name : names) {
    if (!options.quiet) remark("scene {}\n", name);
    scenes.push_back(embedded_scene(options, name, device));
  }
  for (const NamedScene& scene : scenes)
    if (scene.view >= scene.scene.views.views.size())
      fail(ErrorKind::usage, "--view {}: scene '{}' has the views 0 to {}", scene.view, scene.name,
           scene.scene.views.views.size() - 1);
  return scenes;
}

// Devices with the same name are distinguished by their position in --device.
std::string label_of(const std::vector<std::shared_ptr<Device>>& devices, std::size_t i) {
  const std::string& name = devices[i]->info().name;
  const auto same = std::ranges::count_if(devices, [&](const auto& d) { return d->info().name == name; });
  return same > 1 ? fmt::format("{} [{}]", name, i) : name;
}

void write_results(const AccuracyOptions& options, const std::vector<Result>& results) {
  const fs::path folder = options.out;
  write_file_atomically(folder / "accuracy.csv", table_csv(results));
  write_file_atomically(folder / "accuracy.json", json_file_text({{"version", version()},
                                                                  {"build", build_id()},
                                                                  {"date", utc_date()},
                                                                  {"command", command_line()},
                                                                  {"results", table_json(results)}}));
}

int run(const AccuracyOptions& options) {
  files_before_output();
  options.settings.resolve();  // reports invalid settings before scenes are made
  accuracy::MeasureOptions measure_options{.configurations = configurations(options),
                                           .rounds = options.rounds,
                                           .sample_ms = options.quick ? 1.0 : 10.0,
                                           .stop = {},
                                           .on_progress = {}};
  std::vector<std::shared_ptr<Device>> devices;
  for (const std::string& name : options.devices.empty() ? std::vector<std::string>{""} : options.devices)
    devices.push_back(open_device(name));
  const auto held = lock_output_folder(options.out, {"accuracy.csv", "accuracy.json"},
                                       {options.data, options.model}, options.overwrite);
  const std::vector<NamedScene> scenes = load_scenes(options, *devices.front());

  const InterruptGuard guard;
  measure_options.stop = [&] { return guard.interrupted(); };
  std::vector<Result> results;
  if (!options.quiet) say("{}\n", table_header());
  for (std::size_t i = 0; i < devices.size(); ++i)
    for (const NamedScene& scene : scenes) {
      if (guard.interrupted()) break;
      const std::string device = label_of(devices, i);
      measure_options.on_progress = [&](const std::string& text) {
        if (!options.quiet) remark("{}, {}: {}\n", device.substr(0, 32), scene.name, text);
      };
      std::vector<Result> fresh = measure(*devices[i], scene, measure_options);
      for (Result& result : fresh) {
        result.device = device;
        if (!options.quiet) say("{}\n", table_row(result));
      }
      flush_out();
      results.insert(results.end(), fresh.begin(), fresh.end());
    }
  if (!results.empty()) write_results(options, results);
  return guard.interrupted() ? kInterruptedExitCode : 0;
}

}  // namespace

Command add_accuracy(CLI::App& root) {
  CLI::App* app = root.add_subcommand(
      "accuracy", "Measure the errors (against float64) and the times of approximations (docs/accuracy.md)");
  const auto options = std::make_shared<AccuracyOptions>(*app);
  app->add_option("--out", options->out, "folder for accuracy.csv and accuracy.json")
      ->required()
      ->type_name("DIR");
  app->add_option("--scene", options->scenes,
                  "built-in scenes, which are trained briefly [all, unless --model is given]")
      ->check(CLI::IsMember(synthetic_scene_names()))
      ->delimiter(',')
      ->type_name("A,B,...");
  add_model_option(*app, "model,--model", options->model,
                   "splat model or run folder, measured with a view of --data");
  app->add_option("data,--data", options->data, kRunDataHelp)->type_name("DIR|FILE");
  app->add_option("--split", options->split, "split of --data [test]")->type_name("NAME");
  app->add_option("--view", options->view, "index of the view [0]")->check(not_negative())->type_name("K");
  app->add_option("--device", options->devices,
                  "devices, as listed by 'ubs devices' [UBS_DEVICE, otherwise the first GPU]")
      ->delimiter(',')
      ->type_name("A,B,...");
  app->add_option("--config", options->configurations,
                  "measure this configuration and the default settings, instead of the standard "
                  "configurations (repeatable); the settings after | apply to the float64 reference")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("LABEL:KEY=VALUE,...[|KEY=VALUE]");
  app->add_option("--splats", options->splats, "number of splats of built-in scenes [10000]")
      ->check(from_to(1, 10'000'000))
      ->type_name("COUNT");
  app->add_option("--size", options->size, "width and height of the images of built-in scenes [200]")
      ->check(from_to(16, 4096))
      ->type_name("PIXELS");
  app->add_option("--iterations", options->iterations,
                  "number of training iterations of built-in scenes [300]")
      ->check(from_to(1, 100'000))
      ->type_name("COUNT");
  app->add_option(
         "--dim", options->dim,
         "number of dimensions of built-in scenes; the dynamic scene orbit adds time, so 3 becomes 4 and 6 "
         "becomes 7 [6]")
      ->check(CLI::IsMember({3, 4, 6, 7}))  // built-in scenes have no further query values
      ->type_name("N");
  app->add_option("--rounds", options->rounds, "number of repetitions of the time measurements [9]")
      ->check(from_to(1, 10'000))
      ->type_name("COUNT");
  app->add_flag("--quick", options->quick,
                "measure one tiny scene with two configurations, which takes seconds");
  app->add_flag("--quiet", options->quiet, "print errors and warnings only");
  add_overwrite_option(*app, options->overwrite);
  // --split only applies to a model, and the options in the list below only apply to built-in scenes.
  app->get_option("--split")->needs("--model");
  return {app, [app, options] {
            for (const char* name : {"--splats", "--size", "--iterations", "--dim"})
              if (app->count(name) > 0 && !options->model.empty() && options->scenes.empty())
                fail(ErrorKind::usage, "{} only applies to built-in scenes: select one with --scene", name);
            const auto quick = [&](const char* name, auto& value, int small) {
              if (options->quick && app->count(name) == 0)
                value = static_cast<std::remove_reference_t<decltype(value)>>(small);
            };
            quick("--splats", options->splats, 600);
            quick("--size", options->size, 48);
            quick("--iterations", options->iterations, 40);
            quick("--rounds", options->rounds, 3);
            return run(*options);
          }};
}

}  // namespace ubs::tools
