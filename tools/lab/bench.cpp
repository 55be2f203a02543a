// SPDX-License-Identifier: Apache-2.0
// ubs-lab bench: times every stage, whole iterations and rendering on one or several devices. Prints a table,
// writes JSON, and compares with an earlier run.
#include <CLI/CLI.hpp>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/device/registry.hpp"
#include "host/formats/splat_file.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/lab/bench/report.hpp"
#include "host/run/verified_device.hpp"
#include "host/settings/fields.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/program_version.hpp"
#include "tools/lab/bench_data.hpp"
#include "tools/lab/lab_commands.hpp"

namespace ubs::tools {
namespace {

using namespace ubs::bench;

constexpr int kRegressionExitCode = 8;

struct BenchOptions {
  std::string regex, garden, model, data, json, baseline, raster = "auto";
  std::vector<std::string> devices, sizes, assignments;
  int dim = 6;
  RunData run;  // data of the model's run
  bool list = false, quick = false, overwrite = false;
  double min_time = 0.3, max_time = 2, uncertainty = 0.01;
};

TrainSettings training_settings(BenchOptions& options) {
  TrainSettings settings;
  if (!options.model.empty()) options.run = use_run_data(options.model, options.data, {});
  read_as(settings, options.run);
  settings.background.colour = {1, 1, 1};
  settings.dim = options.dim;
  settings.raster = options.raster;
  const auto fields = bind_fields(settings, train_fields());
  for (const std::string& assignment : options.assignments) set_field(fields, assignment, "--set");
  validate(settings);
  return settings;
}

CaseOptions case_options(const BenchOptions& options, const TrainSettings& training) {
  CaseOptions cases{.quick = options.quick};
  for (const std::string& size : options.sizes) cases.sizes.push_back(parse_scene_size(size));
  if (!options.garden.empty()) cases.garden = garden_size(options.garden);
  if (!options.model.empty()) {
    cases.model = bench_model_size(options.model, options.data, training, options.run.opened);
    cases.mixed_model = load_splat_model(options.model).model.mixed();
  }
  return cases;
}

bench::RunOptions run_options(const BenchOptions& options, const TrainSettings& training) {
  bench::RunOptions run;
  run.raster = options.raster;
  run.dim = options.dim;
  run.quick = options.quick;
  run.limits = {options.uncertainty, options.min_time, std::max(options.min_time, options.max_time), 5};
  if (options.quick) run.limits = {1, 0, 0.05, 2};
  run.garden = options.garden;
  run.open_model = [=] {
    return open_bench_model(options.model, options.data, training, options.run.opened);
  };
  run.training = training;
  run.on_begin = [](const DeviceReport& report) {
    say("\n{} (raster {})\n{}\n", describe(report.info), report.raster, bench::table_header());
    flush_out();
  };
  run.on_result = [](const CaseResult& result) {
    say("{}\n", table_row(result));
    flush_out();
  };
  return run;
}

std::vector<BaselineEntry> load_baseline(const std::string& path) {
  return read_baseline(parse_own_json(read_text_file(path), path), path);
}

Json file_json(const std::vector<DeviceReport>& reports, TrainSettings training) {
  const Json bench_settings = to_json(bind_fields(training, train_fields()));
  Json devices = Json::array();
  for (const DeviceReport& report : reports) devices.push_back(bench::to_json(report));
  return {{"version", version()},         {"build", build_id()},
          {"date", utc_date()},           {"host", host_name()},
          {"command", command_line()},    {"alpha_min", training.alpha_min},
          {"freeze", training.freeze},    {"math", bench_settings.at("math")},
          {"devices", std::move(devices)}};
}

int run(BenchOptions& options) {
  if (!options.json.empty()) files_before_output();
  const TrainSettings training = training_settings(options);
  const std::vector<BenchCase> cases =
      select_cases(all_cases(case_options(options, training)), options.regex);
  if (cases.empty())
    fail(ErrorKind::usage, "--run '{}' matches no case: list the cases with --list", options.regex);
  const ModelVariant form = training.variant;
  if (form != ModelVariant{} &&
      std::ranges::any_of(cases, [](const BenchCase& which) { return which.scene == "synthetic"; }))
    fail(ErrorKind::usage,
         "scene 'synthetic' only exists in the default variant, not as '{}': choose other scenes with --run",
         to_string(form));
  if (options.list) {
    for (const BenchCase& which : cases) say("{}\n", which.name());
    return 0;
  }
  check_output_files({options.json}, {options.baseline, options.model, options.garden, options.data},
                     options.overwrite);
  std::vector<BaselineEntry> baseline;
  if (!options.baseline.empty()) baseline = load_baseline(options.baseline);
  bench::RunOptions run = run_options(options, training);
  run.cases = cases;
  std::vector<DeviceReport> reports;
  const std::vector<std::string> devices =
      options.devices.empty() ? std::vector<std::string>{""} : options.devices;
  const std::vector<DeviceInfo> known = list_devices();
  for (const std::string& device : devices) choose_device(known, device);  // check all names before measuring
  const InterruptGuard guard;
  run.stop = [&] { return guard.interrupted(); };
  for (const std::string& device : devices)
    if (!guard.interrupted())
      reports.push_back(run_cases(*open_verified_device(device, training_use(run.training)), run));

  if (const std::string text = device_comparison(reports); !text.empty()) say("\n{}", text);
  if (!options.json.empty())
    write_file_atomically(options.json, json_file_text(file_json(reports, training)));
  const int code = guard.interrupted() ? kInterruptedExitCode : 0;
  if (options.baseline.empty()) return code;
  const std::vector<bench::Comparison> comparisons = compare(reports, baseline);
  if (comparisons.empty() && code != 0) return code;
  if (comparisons.empty())  // this must not look like a success
    fail(ErrorKind::data, "{}: the baseline contains no case of this run, so nothing was compared",
         options.baseline);
  say("\n{}", comparison_text(comparisons));
  const auto slower = std::ranges::count_if(comparisons, &bench::Comparison::regression);
  if (slower > 0) say("{} of {} cases are slower than the baseline\n", slower, comparisons.size());
  return code != 0 ? code : slower > 0 ? kRegressionExitCode : 0;
}

}  // namespace

Command add_bench(CLI::App& root) {
  const auto options = std::make_shared<BenchOptions>();
  CLI::App* app = root.add_subcommand("bench", "Measure speed and memory (docs/benchmarks.md)");
  app->add_option("--run", options->regex,
                  "run only cases whose names contain a match of this regular expression")
      ->type_name("REGEX");
  app->add_flag("--list", options->list, "print the names of the cases without running them");
  app->add_option("--device", options->devices,
                  "devices to compare, as listed by 'ubs devices' [UBS_DEVICE, otherwise the first GPU]")
      ->delimiter(',')
      ->type_name("A,B,...");
  app->add_option("--raster", options->raster, "kernels that sort and rasterise the splats: auto, cpu or gpu")
      ->check(CLI::IsMember({"auto", "cpu", "gpu"}))
      ->type_name("KIND");
  app->add_option("--dim", options->dim,
                  "number of dimensions of the models; the dynamic scene orbit adds time, so 3 becomes 4 and "
                  "6 becomes 7 [6]")
      ->check(from_to(3, 11))
      ->type_name("N");
  app->add_option("--sizes", options->sizes,
                  "image sizes and numbers of splats of all built-in scenes, such as 400x400/100K")
      ->delimiter(',')
      ->type_name("WxH/SPLATS,...");
  app->add_option("--garden", options->garden,
                  "folder with the arrays of gsplat's test_garden.npz as float .npy files")
      ->type_name("DIR");
  CLI::Option* model = add_model_option(*app, "model,--model", options->model,
                                        "splat model or run folder, measured with the cameras of --data");
  app->add_option("data,--data", options->data, "data folder with the cameras for --model [data of the run]")
      ->needs(model)
      ->type_name("DIR");
  app->add_option("--set", options->assignments,
                  "a setting for all cases, such as kernel=gaussian or math=native (docs/variants.md, "
                  "docs/accuracy.md), or a setting for reading --data, such as downscale=2")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("KEY=VALUE");
  app->add_option("--min-time", options->min_time, "minimum time per case in seconds [0.3]")
      ->check(not_negative())
      ->type_name("S");
  app->add_option("--max-time", options->max_time, "maximum time per case in seconds [2]")
      ->check(positive())
      ->type_name("S");
  app->add_option(
         "--uncertainty", options->uncertainty,
         "repeat until the standard error of the median is at most this fraction of the median [0.01]")
      ->check(positive())
      ->type_name("SHARE");
  app->add_flag("--quick", options->quick,
                "run tiny cases with few repetitions, to check that everything runs");
  app->add_option("--json", options->json, "write all results to this file")->type_name("FILE");
  app->add_option("--baseline", options->baseline,
                  "compare with a file written by --json; exit code 8 if a case is significantly slower")
      ->type_name("FILE");
  add_overwrite_option(*app, options->overwrite);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
