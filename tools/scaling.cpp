// SPDX-License-Identifier: Apache-2.0
// ubs bench scaling: how time and memory of training grow, as CSV, exponents and a plot.
#include "host/bench/scaling.hpp"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/device/registry.hpp"
#include "host/run/proved_device.hpp"
#include "tools/commands.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

using namespace ubs::bench;

struct ScalingToolOptions {
  std::string out, device;
  bench::ScalingOptions scaling;
  bool processor_time = false, overwrite = false;
};

void print_point(const ScalingPoint& p) {
  if (!p.note.empty())
    say("{:<7} {:>9.0f}  {}\n", p.series, p.x, p.note);
  else
    say("{:<7} {:>9.0f}  {:>9} splats {:>4}x{:<4} N {} views {:>3} batch {}  {:>10.2f} ms (processor {:.2f}) "
        " {:>8.1f} MiB  {} "
        "intersections\n",
        p.series, p.x, p.splats, p.width, p.height, p.dim, p.views, p.batch, p.iteration_ms, p.cpu_ms,
        static_cast<double>(p.peak_bytes) / (1 << 20), p.intersections);
  flush_out();
}

Json fits_json(const std::vector<ScalingFit>& fits, const DeviceInfo& device) {
  Json series = Json::object();
  for (const ScalingFit& f : fits)
    series[f.series] = {{"time_exponent", f.time.exponent},
                        {"time_exponent_upper_half", f.time_upper.exponent},
                        {"memory_exponent", f.memory.exponent},
                        {"memory_exponent_upper_half", f.memory_upper.exponent}};
  return {{"version", version()},      {"build", build_id()},           {"date", utc_date()},
          {"command", command_line()}, {"device", device_json(device)}, {"series", std::move(series)}};
}

int run(ScalingToolOptions options) {
  files_before_output();
  const auto held = take_folder(options.out, {"scaling.csv", "scaling.json", "scaling.svg"}, {}, options.overwrite);
  const std::unique_ptr<Device> device = open_proved_device(options.device, training_use({}));
  say("{}\n", describe(device->info()));
  const TimeKind kind = options.processor_time ? TimeKind::processor : TimeKind::wall;
  if (options.processor_time && device->info().type != DeviceType::cpu)
    fail(ErrorKind::usage, "--processor-time is for CPU devices, {} is none", device->info().name);
  options.scaling.on_point = print_point;
  const std::vector<ScalingPoint> points = measure_scaling(*device, options.scaling);
  const std::filesystem::path folder = options.out;
  write_file_atomically(folder / "scaling.csv", scaling_csv(points));
  const std::vector<ScalingFit> fits = fit_scaling(points, kind);
  write_file_atomically(folder / "scaling.json", json_file_text(fits_json(fits, device->info())));
  write_file_atomically(folder / "scaling.svg", scaling_plot(points, fits, device->info().name, kind));
  say("\n{}\nscaling.csv, scaling.json and scaling.svg in {}\n", scaling_text(fits), options.out);
  return 0;
}

}  // namespace

Command add_scaling(CLI::App& bench) {
  const auto options = std::make_shared<ScalingToolOptions>();
  ScalingOptions& scaling = options->scaling;
  CLI::App* app = bench.add_subcommand("scaling", "Measure how time and memory grow (docs/benchmarks.md)");
  app->add_option("--out", options->out, "folder for scaling.csv, scaling.json, scaling.svg")
      ->required()
      ->type_name("DIR");
  add_device_option(*app, options->device);
  app->add_option("--raster", scaling.raster, "auto|cpu|gpu: rasteriser and lists")
      ->check(CLI::IsMember({"auto", "cpu", "gpu"}))
      ->type_name("KIND");
  app->add_option("--max-splats", scaling.max_splats, "largest model [3000000]")
      ->check(from_to(1'000, 100'000'000))
      ->type_name("COUNT");
  app->add_option("--max-side", scaling.max_side, "largest width and height of images [2000]")
      ->check(from_to(32, 16384))
      ->type_name("PIXELS");
  app->add_option("--max-time", scaling.limits.max_seconds, "most seconds a point [4]")
      ->check(positive())
      ->type_name("S");
  app->add_flag("--processor-time", options->processor_time,
                "fit and draw processor time a core instead of wall time: for CPUs that others use too");
  app->add_flag("--quick", scaling.quick, "tiny points only: shows that everything runs");
  add_overwrite_option(*app, options->overwrite);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
