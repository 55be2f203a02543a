// SPDX-License-Identifier: Apache-2.0
// ubs accuracy: errors against float64 beside times, for configurations of the kernels on scenes and devices.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "host/accuracy/accuracy_report.hpp"
#include "host/accuracy/baseline.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/bench/runner.hpp"
#include "host/data/synthetic.hpp"
#include "host/run/open_data.hpp"
#include "tools/commands.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;
using namespace ubs::accuracy;

constexpr int kErrorRegressionExitCode = 8;
constexpr const char* kTruth =
    "float64 by the oracle of host/oracle: the formulas of the method written independently, gradients "
    "by a tape";

std::vector<std::string_view> accuracy_keys() {
  std::vector<std::string_view> keys = drawing_keys();
  keys.insert(keys.end(), {"lambda_dssim", "query_grad"});
  return keys;
}

struct AccuracyOptions {
  explicit AccuracyOptions(CLI::App& app) : settings(app, accuracy_keys()) {}
  SettingsOptions settings;
  std::vector<std::string> scenes, devices, configurations;
  std::string data, model, split = "test", out, baseline;
  std::size_t view = 0, splats = 10'000, rounds = 9;
  int size = 200, iterations = 300, dim = 6;
  double sample_ms = 10;
  bool quick = false, processor_time = false, no_stages = false, quiet = false, json = false, overwrite = false;
};

// Of a configuration measure() asks for the form of the method and these.
void check_measured(const Configuration& c) {
  constexpr std::string_view kMeasured[] = {"math",         "alpha_min",  "raster",    "query_grad",
                                            "lambda_dssim", "near_plane", "far_plane", "eps2d"};
  for (const auto* part : {&c.settings, &c.truth})
    for (const std::string& assignment : *part) {
      const std::string key = assignment.substr(0, assignment.find('='));
      const bool of_kernels = part == &c.settings && std::ranges::count(kMeasured, key) > 0;
      if (!of_kernels && !variant_values(key))
        fail(
            ErrorKind::usage,
            "--config: {} of '{}' changes nothing here: choose the form of the method (docs/variants.md){}{}",
            key, c.label, part == &c.settings ? " or one of " : "",
            part == &c.settings ? fmt::format("{}", fmt::join(kMeasured, ", ")) : "");
    }
}

// The default comes first in any case: times are ratios to it.
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
  const RunData run = use_run_data(options.model, data);
  LoadedModel loaded = open_model(options.model);
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, run);
  Split split = open_split_for(loaded.offset, data, options.split, settings, Images::load, run.opened);
  require_images(split);
  const SplatModel& model = loaded.model.single("ubs accuracy");
  check_query(split, model.dim);
  bench::BenchScene scene{model, std::move(split), {}};
  for (std::size_t c = 0; c < 3; ++c) scene.background[c] = static_cast<float>(settings.background.colour[c]);
  return {fs::path(options.model).filename().string(), std::move(scene), options.view, settings};
}

std::vector<NamedScene> load_scenes(const AccuracyOptions& options, Device& device) {
  std::vector<NamedScene> scenes;
  if (options.model.empty() && !options.data.empty())
    fail(ErrorKind::usage, "--data has the images that a model is compared with: name it with --model");
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

std::vector<std::string> header_lines(const AccuracyOptions& options,
                                      const std::vector<std::shared_ptr<Device>>& devices,
                                      const std::vector<NamedScene>& scenes) {
  std::vector<std::string> lines{"* date: " + utc_date(), "* command: `" + command_line() + "`",
                                 "* " + version_line()};
  for (const auto& device : devices) lines.push_back("* device: " + describe(device->info()));
  for (const NamedScene& s : scenes) {
    const Camera& camera = s.scene.views.views[s.view].camera;
    lines.push_back(fmt::format("* scene {}: {} splats, N = {}, view {} of {}x{}", s.name,
                                s.scene.model.count, s.scene.model.dim, s.view, camera.width, camera.height));
  }
  lines.push_back(std::string("* truth: ") + kTruth);
  lines.push_back(fmt::format(
      "* times: {} time, medians of {} rounds that take every configuration in turn; forward = projection, "
      "lists, rasteriser; iteration = with loss and backward, without update",
      options.processor_time ? "processor" : "wall", options.rounds));
  lines.push_back(
      "* errors: relative 2-norm, of gradients without the 1 % of splats that differ most; front: no other "
      "configuration is better by 10 % in error or by 2 % (and three standard errors) in time and as good in "
      "the other");
  return lines;
}

// Devices of one name are told apart by their place in --device.
std::string label_of(const std::vector<std::shared_ptr<Device>>& devices, std::size_t i) {
  const std::string& name = devices[i]->info().name;
  const auto same = std::ranges::count_if(devices, [&](const auto& d) { return d->info().name == name; });
  return same > 1 ? fmt::format("{} [{}]", name, i) : name;
}

void write_results(const AccuracyOptions& options, const std::vector<Result>& results,
                   const std::vector<std::string>& lines) {
  const fs::path folder = options.out;
  write_file_atomically(folder / "accuracy.csv", accuracy_csv(results));
  write_file_atomically(folder / "accuracy.json", json_file_text({{"version", version()},
                                                                  {"build", build_id()},
                                                                  {"date", utc_date()},
                                                                  {"command", command_line()},
                                                                  {"truth", kTruth},
                                                                  {"results", accuracy_json(results)}}));
  write_file_atomically(folder / "accuracy.svg", accuracy_plot(results));
  write_file_atomically(folder / "accuracy.md", accuracy_page(results, {lines, "accuracy.svg"}));
}

int compare(const AccuracyOptions& options, const std::vector<Result>& results,
            const std::vector<BaselineRow>& baseline, bool interrupted) {
  if (options.baseline.empty()) return 0;
  const std::vector<BaselineComparison> comparisons = compare_with_baseline(results, baseline);
  if (!interrupted) require_compared(options.baseline, comparisons.size());
  const bool worse = std::ranges::any_of(comparisons, &BaselineComparison::regression);
  if (!options.json && (worse || !options.quiet)) say("\n{}", baseline_text(comparisons));
  return worse ? kErrorRegressionExitCode : 0;
}

int run(const AccuracyOptions& options) {
  // `ubs accuracy curve` is parsed without it: nothing that CLI11 can require.
  if (options.out.empty()) fail(ErrorKind::usage, "--out is required (see 'ubs accuracy --help')");
  files_before_output();
  options.settings.resolve();  // what is wrong with them is said before scenes are made
  accuracy::MeasureOptions measure_options{.configurations = configurations(options),
                                           .rounds = options.rounds,
                                           .sample_ms = options.sample_ms,
                                           .processor_time = options.processor_time,
                                           .stages = !options.no_stages,
                                           .stop = {},
                                           .on_progress = {}};
  const std::vector<BaselineRow> baseline =
      options.baseline.empty() ? std::vector<BaselineRow>{} : read_accuracy_baseline(options.baseline);
  std::vector<std::shared_ptr<Device>> devices;
  for (const std::string& name : options.devices.empty() ? std::vector<std::string>{""} : options.devices)
    devices.push_back(open_device(name));
  if (options.processor_time)
    for (const auto& device : devices)
      if (device->info().type != DeviceType::cpu)
        fail(ErrorKind::usage, "--processor-time is for CPU devices, {} is none", device->info().name);
  const Paths names{"accuracy.csv", "accuracy.json", "accuracy.md", "accuracy.svg"};
  const auto held = take_folder(options.out, names, {options.data, options.model, options.baseline}, options.overwrite);
  const std::vector<NamedScene> scenes = load_scenes(options, *devices.front());
  const std::vector<std::string> lines = header_lines(options, devices, scenes);

  const InterruptGuard guard;
  measure_options.stop = [&] { return guard.interrupted(); };
  std::vector<Result> results;
  for (std::size_t i = 0; i < devices.size(); ++i)
    for (const NamedScene& scene : scenes) {
      if (guard.interrupted()) break;
      const std::string device = label_of(devices, i);
      measure_options.on_progress = [&](const std::string& text) {
        if (!options.quiet) remark("{}, {}: {}\n", device.substr(0, 32), scene.name, text);
      };
      std::vector<Result> fresh = measure(*devices[i], scene, measure_options);
      for (Result& result : fresh) result.device = device;
      if (!options.quiet && !options.json)
        say("\n{}, {}\n{}", device, scene.name, result_table(fresh, device, scene.name));
      results.insert(results.end(), fresh.begin(), fresh.end());
    }
  add_means(results);
  if (results.empty()) return kInterruptedExitCode;
  write_results(options, results, lines);
  if (options.json) print_json({{"results", accuracy_json(results)}});
  if (!options.quiet && !options.json)
    say("\naccuracy.csv, accuracy.json, accuracy.md and accuracy.svg in {}\n", options.out);
  const int code = compare(options, results, baseline, guard.interrupted());
  return guard.interrupted() ? kInterruptedExitCode : code;
}

}  // namespace

Command add_accuracy(CLI::App& root, Command& curve) {
  CLI::App* app =
      root.add_subcommand("accuracy", "Measure errors against float64 beside time (docs/accuracy.md)");
  curve = add_curve(*app);  // CLI11 2.4 refuses it behind a positional argument of the same name
  const auto options = std::make_shared<AccuracyOptions>(*app);
  app->add_option("--out", options->out, "folder for accuracy.csv, .json, .md and .svg (needed)")
      ->type_name("DIR");
  app->add_option("--scene", options->scenes,
                  "embedded scenes, trained briefly [all, unless --model is given]")
      ->check(CLI::IsMember(synthetic_scene_names()))
      ->delimiter(',')
      ->type_name("A,B,...");
  add_model_option(*app, "model,--model", options->model,
                   "splat model or run folder, measured with a view of --data");
  app->add_option("data,--data", options->data, kRunDataHelp)->type_name("DIR|FILE");
  app->add_option("--split", options->split, "split of --data [test]")->type_name("NAME");
  app->add_option("--view", options->view, "number of the view [0]")->check(not_negative())->type_name("K");
  app->add_option("--device", options->devices, "devices, as listed by 'ubs devices' [as other commands]")
      ->delimiter(',')
      ->type_name("A,B,...");
  app->add_option(
         "--config", options->configurations,
         "a configuration beside the default instead of the standard ones; behind a bar what the truth has "
         "(repeatable)")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("LABEL:KEY=VALUE,...[|KEY=VALUE]");
  app->add_option("--splats", options->splats, "of embedded scenes [10000]")
      ->check(from_to(1, 10'000'000))
      ->type_name("COUNT");
  app->add_option("--size", options->size, "width and height of embedded scenes [200]")
      ->check(from_to(16, 4096))
      ->type_name("PIXELS");
  app->add_option("--iterations", options->iterations, "of training embedded scenes [300]")
      ->check(from_to(1, 100'000))
      ->type_name("COUNT");
  app->add_option("--dim", options->dim, "N of embedded scenes; orbit has one more than 3 or 6 [6]")
      ->check(CLI::IsMember({3, 4, 6, 7}))  // they have no further query values
      ->type_name("N");
  app->add_option("--rounds", options->rounds, "of timing [9]")
      ->check(from_to(1, 10'000))
      ->type_name("COUNT");
  app->add_option("--sample-ms", options->sample_ms, "least time of a sample [10]")
      ->check(positive())
      ->type_name("MS");
  app->add_flag("--processor-time", options->processor_time,
                "processor time instead of wall time: for CPUs that others use too");
  app->add_flag("--no-stages", options->no_stages, "end to end only");
  app->add_option("--baseline", options->baseline,
                  "accuracy.json of an earlier run; exit code 8 where errors grew")
      ->type_name("FILE");
  app->add_flag("--quick", options->quick, "one tiny scene and two configurations: seconds");
  app->add_flag("--quiet", options->quiet, "print errors and warnings only");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "print the JSON of the results");
  // What a model has, and what embedded scenes have, of which a model alone has none.
  app->get_option("--split")->needs("--model");
  return {app, [app, options] {
            for (const char* name : {"--splats", "--size", "--iterations", "--dim"})
              if (app->count(name) > 0 && !options->model.empty() && options->scenes.empty())
                fail(ErrorKind::usage, "{} is of embedded scenes: name them with --scene", name);
            const auto quick = [&](const char* name, auto& value, int small) {
              if (options->quick && app->count(name) == 0)
                value = static_cast<std::remove_reference_t<decltype(value)>>(small);
            };
            quick("--splats", options->splats, 600);
            quick("--size", options->size, 48);
            quick("--iterations", options->iterations, 40);
            quick("--rounds", options->rounds, 3);
            quick("--sample-ms", options->sample_ms, 1);
            return run(*options);
          }};
}

}  // namespace ubs::tools
