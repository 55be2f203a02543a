// SPDX-License-Identifier: Apache-2.0
// ubs tune: finds the fastest values of the kernels' constants on a device and stores them for later runs.
#include <CLI/CLI.hpp>
#include <memory>

#include "host/base/error.hpp"
#include "host/bench/tuner.hpp"
#include "host/device/registry.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {
namespace {

struct Options {
  std::string device, raster = "auto";
  bool quick = false, dry_run = false;
};

std::string verdict(const bench::Trial& trial) {
  if (!trial.note.empty()) return trial.note;
  return fmt::format("{:.3f} +- {:.3f} of the time{}{}", trial.ratio, trial.uncertainty,
                     trial.difference > 0 ? fmt::format(", results differ by {:.0e}", trial.difference) : "",
                     trial.kept ? "  <- kept" : "");
}

int run(const Options& options) {
  const std::unique_ptr<Device> device = open_device(options.device);
  const RasterKind raster = raster_kind(options.raster, device->info());
  const std::string file = tuning_file(device->info()).string();
  if (file.empty() && !options.dry_run)
    fail(ErrorKind::usage, "no folder for the result: set UBS_TUNING_DIR, XDG_CACHE_HOME or HOME");
  fmt::print("{}, kernels for {}\n", describe(device->info()), raster == RasterKind::cpu ? "CPUs" : "GPUs");
  const auto on_trial = [](const bench::Trial& trial) {
    fmt::print("  {:<22} {:>5}  {}\n", trial.macro, trial.value, verdict(trial));
    std::fflush(stdout);
  };
  const TuningValues values =
      bench::tune(*device, {.raster = raster, .quick = options.quick, .on_trial = on_trial});
  fmt::print("{} of {} constants differ from their defaults", values.size(),
             std::ranges::count(opencl::tuned_constants(), raster, &TunedConstant::raster));
  for (const auto& [macro, value] : values) fmt::print(", {} = {}", macro, value);
  if (options.dry_run) {
    fmt::print("; nothing is stored (--dry-run)\n");
  } else {
    save_tuning(device->info(), opencl::tuned_constants(), raster, values);
    fmt::print("; stored in {}\n", file);
  }
  return 0;
}

}  // namespace

Command add_tune(CLI::App& root) {
  const auto options = std::make_shared<Options>();
  CLI::App* app =
      root.add_subcommand("tune", "Find the fastest kernel constants on a device (docs/tuning.md)");
  add_device_option(*app, options->device);
  app->add_option("--raster", options->raster, "auto|cpu|gpu: which kernels")
      ->check(CLI::IsMember({"auto", "cpu", "gpu"}))
      ->type_name("KIND");
  app->add_flag("--quick", options->quick, "a small scene, hardly repeated: shows that everything runs");
  app->add_flag("--dry-run", options->dry_run, "measure and print, store nothing");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
