// SPDX-License-Identifier: Apache-2.0
// ubs accuracy curve: quality on the test views against training time and iterations for several
// configurations.
#include "host/accuracy/curve.hpp"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <map>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/base/warning.hpp"
#include "host/data/synthetic.hpp"
#include "host/device/registry.hpp"
#include "host/run/proved_device.hpp"
#include "host/run/training_data.hpp"
#include "host/spec/settings.hpp"
#include "host/train/run_settings.hpp"
#include "tools/commands.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/settings_options.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;
using namespace ubs::accuracy;

constexpr int kQualityRegressionExitCode = 8;
constexpr int kEvaluations = 20;  // unless eval_every is given

struct CurveOptions {
  explicit CurveOptions(CLI::App& app) : settings(app) {}
  SettingsOptions settings;
  std::vector<std::string> devices, configurations;
  std::string data, scene = "glossy", out, baseline;
  double seconds = 0;
  int views = 0;
  bool sequential = false, quick = false, quiet = false, json = false, overwrite = false;
};

TrainSettings base_settings(const CurveOptions& options) {
  TrainSettings settings = options.settings.resolve();
  if (options.data.empty() || options.quick) {  // in the place of what nobody has chosen
    const auto& chosen = settings.chosen;
    if (!chosen.contains("iterations")) settings.iterations = options.quick ? 60 : 1000;
    if (!chosen.contains("cap_max")) settings.cap_max = options.quick ? 500 : 10'000;
    if (!chosen.contains("init_points")) settings.init_points = settings.cap_max;
  }
  if (settings.eval_every == "0")
    settings.eval_every = std::to_string(std::max(1, settings.iterations / kEvaluations));
  return settings;
}

std::vector<Configuration> configurations(const CurveOptions& options) {
  std::vector<Configuration> all;
  for (const std::string& text : options.configurations) {
    all.push_back(parse_configuration(text));
    if (std::ranges::count(all, all.back().label, &Configuration::label) > 1)
      fail(ErrorKind::usage, "--config: the label '{}' is given twice", all.back().label);
  }
  if (all.empty())
    all = {
        {"3d", {"dim=3"}}, {"6d", {"dim=6"}}, {"gaussian+sh3", {"dim=3", "kernel=gaussian", "colour=sh3"}}};
  if (options.quick && options.configurations.empty())
    all = {{"6d", {"dim=6"}}, {"6d native", {"dim=6", "math=native"}}};
  return all;
}

// What decides how data are read.
std::map<std::string, std::string> reading_settings(TrainSettings settings) {
  constexpr std::string_view kReading[] = {"background", "downscale",       "frames",     "images",
                                           "layout",     "principal_point", "test_every", "refine_cameras"};
  std::map<std::string, std::string> reading;
  for (const FieldValue& field : bind_fields(settings, train_fields()))
    if (std::ranges::find(kReading, field.key) != std::end(kReading)) reading[field.key] = field_text(field);
  return reading;
}

// Data are read once, for the first configuration: what they depend on must be the same for all but N, whose
// check comes per split.
void check_reading(const TrainSettings& base, const std::vector<Configuration>& all) {
  const auto first = reading_settings(apply(base, all.front()));
  for (const Configuration& c : all) {
    const TrainSettings settings = apply(base, c);
    if (settings.dim == kAutoInt)
      fail(ErrorKind::usage, "configuration '{}' leaves N to the data: name it, such as dim=6", c.label);
    for (const auto& [key, text] : reading_settings(settings))
      if (text != first.at(key))
        fail(
            ErrorKind::usage,
            "configuration '{}' has {} = {}, '{}' has {}: data are read once for all, so measure them in two "
            "runs",
            c.label, key, text, all.front().label, first.at(key));
  }
}

// Of those that can be trained; why another one cannot its curve says.
check::Use curves_use(const TrainSettings& base, const std::vector<Configuration>& all) {
  const auto configs = [=](const DeviceInfo& info) {
    std::vector<KernelConfig> forms;
    for (const Configuration& c : all) {
      const TrainSettings settings = apply(base, c);
      try {
        validate(settings);
      } catch (const Error&) {
        continue;
      }
      forms.push_back(kernel_config(settings.dim, settings.variant, settings, info));
    }
    return forms;
  };
  return {configs, check::kTraining};
}

class Data {
 public:
  Data(const CurveOptions& options, TrainSettings settings) : folder_(options.data) {
    if (options.data.empty()) {
      SyntheticOptions synthetic{.scene = options.scene};
      if (options.quick) {
        synthetic.width = synthetic.height = 48;
        synthetic.train_views = 8;
        synthetic.test_views = 2;
        synthetic.supersampling = 1;
      }
      temporary_ = std::make_unique<TemporaryFolder>();
      folder_ = temporary_->path() / "scene";
      export_synthetic(synthetic, folder_);
    }
    dataset_ = open_dataset(folder_, {"train", "test"}, settings, Images::load);
    warn_skipped(dataset_.report);
    splits_.train = take_train(dataset_, settings);
    splits_.test = take_test(dataset_, settings);
    if (splits_.test.views.empty())
      fail(ErrorKind::data, "{} has no test views to measure on", folder_.string());
    limit(splits_.test.views, options.views);
  }
  const CurveData& splits(const TrainSettings& settings) const {
    check_query(splits_.train, settings.dim);
    check_query(splits_.test, settings.dim);
    return splits_;
  }
  SplatModel start(const CurveData& splits, const TrainSettings& settings) const {
    return initial_model(dataset_, splits.train, settings);
  }

 private:
  static void limit(std::vector<View>& views, int most) {  // evenly spaced
    const auto count = static_cast<std::size_t>(most);
    if (most == 0 || views.size() <= count) return;
    for (std::size_t k = 0; k < count; ++k) std::swap(views[k], views[k * views.size() / count]);
    views.resize(count);
  }

  fs::path folder_;
  std::unique_ptr<TemporaryFolder> temporary_;
  Dataset dataset_;
  CurveData splits_;
};

void write_results(const CurveOptions& options, const std::vector<Curve>& curves) {
  const fs::path folder = options.out;
  write_file_atomically(folder / "curve.csv", curve_csv(curves));
  write_file_atomically(folder / "curve.svg", curve_plot(curves));
}

void write_summary(const CurveOptions& options, const TrainSettings& settings,
                   const std::vector<std::shared_ptr<Device>>& devices, const std::vector<Curve>& curves,
                   bool interrupted) {
  std::string page = "# Quality against training time\n\n* date: " + utc_date() + "\n* command: `" +
                     command_line() + "`\n* " + version_line() + "\n";
  for (const auto& device : devices) page += "* device: " + describe(device->info()) + "\n";
  page += fmt::format(
      "* {} iterations each, schedule of that length; evaluated every {}; {}{}\n", settings.iterations,
      settings.eval_every,
      options.sequential ? "one training after the other" : "trainings take turns between evaluations",
      interrupted ? "; interrupted" : "");
  page +=
      "* all start from the same points and colours with the same seed; seconds are of training, without "
      "evaluations\n";
  page += "\n![curves](curve.svg)\n\n" + curve_table(curves);
  write_file_atomically(fs::path(options.out) / "curve.md", page);
  write_file_atomically(fs::path(options.out) / "curve.json",
                        json_file_text({{"version", version()},
                                        {"build", build_id()},
                                        {"date", utc_date()},
                                        {"command", command_line()},
                                        {"interrupted", interrupted},
                                        {"curves", curves_json(curves)}}));
}

int compare(const CurveOptions& options, const std::vector<Curve>& curves, const std::vector<Curve>& baseline,
            bool interrupted) {
  if (options.baseline.empty()) return 0;
  const std::vector<CurveComparison> comparisons = compare_curves(curves, baseline);
  if (!interrupted) require_compared(options.baseline, comparisons.size());
  const bool worse = std::ranges::any_of(comparisons, &CurveComparison::regression);
  if (!options.json && (worse || !options.quiet)) say("\n{}", comparison_text(comparisons));
  return worse ? kQualityRegressionExitCode : 0;
}

int run(const CurveOptions& options) {
  files_before_output();
  const TrainSettings settings = base_settings(options);
  const std::vector<Configuration> chosen = configurations(options);
  check_reading(settings, chosen);
  std::vector<std::shared_ptr<Device>> devices;
  for (const std::string& name : options.devices.empty() ? std::vector<std::string>{""} : options.devices)
    devices.push_back(open_proved_device(name, curves_use(settings, chosen)));
  const auto held = take_folder(options.out, {"curve.csv", "curve.json", "curve.md", "curve.svg"}, {options.data, options.baseline}, options.overwrite);
  const std::vector<Curve> baseline =
      options.baseline.empty() ? std::vector<Curve>{} : read_curves(options.baseline);

  const Data data(options, apply(settings, chosen.front()));
  const InterruptGuard guard;
  const std::vector<Curve> curves = measure_curves(
      devices, {.configurations = chosen,
                .base = settings,
                .max_seconds = options.seconds,
                .sequential = options.sequential,
                .data = [&](const TrainSettings& s) -> const CurveData& { return data.splits(s); },
                .initial_model = [&](const CurveData& splits,
                                     const TrainSettings& s) { return data.start(splits, s); },
                .stop = [&] { return guard.interrupted(); },
                .on_point =
                    [&](const std::vector<Curve>& all, const Curve& grown) {
                      write_file_atomically(fs::path(options.out) / "curve.csv", curve_csv(all));
                      if (!grown.note.empty()) return warn("{}: {}", grown.name(), grown.note);
                      if (options.quiet || grown.points.empty()) return;
                      const CurvePoint& p = grown.points.back();
                      remark("{:<24} {:>6}/{}  {:>7.1f} s  {:>7} splats  {:.3f} dB  SSIM {:.4f}\n",
                             grown.name(), p.iteration, settings.iterations, p.seconds, p.splats, p.psnr,
                             p.ssim);
                    }});
  write_results(options, curves);
  write_summary(options, settings, devices, curves, guard.interrupted());
  if (options.json)
    print_json({{"curves", curves_json(curves)}});
  else if (!options.quiet)
    say("\n{}\ncurve.csv, curve.json, curve.md and curve.svg in {}\n", curve_table(curves), options.out);
  if (std::ranges::all_of(curves, [](const Curve& c) { return !c.note.empty() && c.points.empty(); }))
    fail(ErrorKind::usage, "no configuration runs: {}", curves.front().note);
  const int code = compare(options, curves, baseline, guard.interrupted());
  return guard.interrupted() ? kInterruptedExitCode : code;
}

}  // namespace

Command add_curve(CLI::App& accuracy) {
  CLI::App* app =
      accuracy.add_subcommand("curve", "Measure test quality against training time (docs/accuracy.md)");
  const auto options = std::make_shared<CurveOptions>(*app);
  app->add_option("--out", options->out, "folder for curve.csv, .json, .md and .svg")
      ->required()
      ->type_name("DIR");
  app->add_option("data,--data", options->data, "data folder or packed file [an embedded scene]")
      ->type_name("DIR|FILE");
  app->add_option("--scene", options->scene, "embedded scene without --data [glossy]")
      ->check(CLI::IsMember(synthetic_scene_names()))
      ->excludes("--data")
      ->type_name("NAME");
  app->add_option("--config", options->configurations, "a configuration (repeatable) [3d, 6d, gaussian+sh3]")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("LABEL:KEY=VALUE,...");
  app->add_option("--device", options->devices, "devices, as listed by 'ubs devices' [as other commands]")
      ->delimiter(',')
      ->type_name("A,B,...");
  app->add_option("--seconds", options->seconds,
                  "most seconds of training, each; 0: to the last iteration [0]")
      ->check(not_negative())
      ->type_name("S");
  app->add_option("--test-views", options->views, "test views that are measured, evenly spaced; 0: all [0]")
      ->check(from_to(0, 1'000'000))
      ->type_name("COUNT");
  app->add_flag("--sequential", options->sequential, "one training after the other instead of taking turns");
  app->add_option("--baseline", options->baseline,
                  "curve.json of an earlier run; exit code 8 where quality fell")
      ->type_name("FILE");
  app->add_flag("--quick", options->quick, "one tiny scene and two configurations: seconds");
  app->add_flag("--quiet", options->quiet, "print errors and warnings only");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "print the JSON of the curves");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
