// SPDX-License-Identifier: Apache-2.0
// ubs sweep: error of single precision against stiffness, for the product's formulas and their textbook form.
#include "host/stress/sweep.hpp"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/data/image.hpp"
#include "host/device/registry.hpp"
#include "tools/commands.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/output.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

using namespace ubs::stress;

struct Options {
  std::string out, device;
  SweepOptions sweep;
  bool json = false, quick = false, no_times = false;
};

Json errors_json(const SweepErrors& e) {
  return {{"value", e.value},
          {"gradient", e.gradient},
          {"group", e.group},
          {"worst_value", e.worst_value},
          {"worst_gradient", e.worst_gradient},
          {"disagreed", e.disagreed}};
}

Json times_json(const SweepTimes& t) {
  const auto pair = [](const double(&v)[2]) { return Json{{"safe", v[0]}, {"naive", v[1]}}; };
  return {{"project_forward", pair(t.project_forward)},
          {"project_backward", pair(t.project_backward)},
          {"blend", pair(t.blend)}};
}

Json results_json(const std::vector<SweepResult>& results, const SweepTimes* times,
                  const DeviceInfo& device) {
  Json sweeps = Json::array();
  for (const SweepResult& r : results) {
    Json points = Json::array();
    for (const SweepPoint& p : r.points)
      points.push_back({{"x", p.x},
                        {"splats", p.splats},
                        {"culled", p.culled},
                        {"safe", errors_json(p.safe)},
                        {"naive", r.has_naive ? errors_json(p.naive) : Json()},
                        {"half_ulp", errors_json(p.half_ulp)}});
    sweeps.push_back(
        {{"name", r.name}, {"title", r.title}, {"x_label", r.x_label}, {"points", std::move(points)}});
  }
  Json json{{"version", version()},      {"build", build_id()},           {"date", utc_date()},
            {"command", command_line()}, {"device", device_json(device)}, {"sweeps", std::move(sweeps)}};
  if (times) json["nanoseconds"] = times_json(*times);
  return json;
}

void print_times(const SweepTimes& t) {
  const auto line = [](const char* name, const double(&v)[2]) {
    fmt::print("{:<34} {:>8.2f} ns safe {:>8.2f} ns naive  {:>5.2f} times\n", name, v[0], v[1], v[0] / v[1]);
  };
  line("project forward, a splat, N = 7", t.project_forward);
  line("project backward, a splat, N = 7", t.project_backward);
  line("blend both ways, a splat and point", t.blend);
}

int run(Options options) {
  if (!options.out.empty()) make_folders(options.out);
  if (options.quick) options.sweep.points = 3, options.sweep.splats = 4;
  const std::unique_ptr<Device> device = open_device(options.device);
  if (!options.json) fmt::print("{}\n", describe(device->info()));
  options.sweep.on_result = [&](const SweepResult& r) {
    if (!options.json) fmt::print(stderr, "{}\n", r.name);
  };
  const std::vector<SweepResult> results = run_sweeps(*device, options.sweep);
  SweepTimes times{};
  if (!options.no_times) times = time_formulations(*device);
  const Json json = results_json(results, options.no_times ? nullptr : &times, device->info());
  if (options.json) {
    print_json(json);
  } else {
    fmt::print("{}", sweep_text(results));
    if (!options.no_times) print_times(times);
  }
  if (options.out.empty()) return 0;
  const std::filesystem::path folder = options.out;
  write_file_atomically(folder / "sweep.csv", sweep_csv(results));
  write_file_atomically(folder / "sweep.json", json_file_text(json));
  save_png(folder / "sweep.png", sweep_plot(results));
  return 0;
}

}  // namespace

Command add_sweep(CLI::App& root) {
  const auto options = std::make_shared<Options>();
  CLI::App* app = root.add_subcommand(
      "sweep", "Measure the error of single precision against stiffness (docs/stability-sweeps.md)");
  app->add_option("sweeps", options->sweep.names,
                  fmt::format("which [all]: {}", fmt::join(sweep_names(), ", ")))
      ->type_name("NAME");
  app->add_option("--out", options->out, "folder for sweep.csv, sweep.json, sweep.png")->type_name("DIR");
  add_device_option(*app, options->device);
  app->add_option("--points", options->sweep.points, "points of each sweep [8 to 15, by sweep]")
      ->check(CLI::Range(1, 1000))
      ->type_name("COUNT");
  app->add_option("--splats", options->sweep.splats, "random splats at each point [32]")
      ->check(CLI::Range(1, 100'000))
      ->type_name("COUNT");
  app->add_option("--seed", options->sweep.seed, "of the random splats [1]")->type_name("N");
  app->add_flag("--no-times", options->no_times, "leave out the time of each formulation");
  app->add_flag("--quick", options->quick, "3 points of 4 splats: shows that everything runs");
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
