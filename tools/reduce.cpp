// SPDX-License-Identifier: Apache-2.0
// ubs reduce: removes splats and dimensions of a trained model that the training views do not need. The limit
// is a number of splats, a file size, a bound for the weights, or a loss of quality. The command measures the
// quality before and after, the size and the speed (docs/reduce.md).
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "host/run/open_data.hpp"
#include "host/run/run_cameras.hpp"
#include "host/run/verified_device.hpp"
#include "host/scene/slice.hpp"
#include "host/settings/fields.hpp"
#include "host/train/evaluate.hpp"
#include "host/train/run_settings.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/program_version.hpp"
#include "tools/reduce_report.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;
using namespace ubs::reduce;

constexpr double kMinBound = 1e-4, kMaxBound = 0.5;  // range of the bound for --max-loss-db
constexpr int kSearchSteps = 9;                      // determines the bound for --max-loss-db to 2 %
constexpr int kSizeSteps = 30;                       // determines the bound for --size to 2e-6 %
constexpr double kMegabyte = 1e6;
constexpr std::size_t kTimedViews = 40;  // maximum number of views for the measurement of times

struct ReduceOptions {
  explicit ReduceOptions(CLI::App& app) : settings(app, drawing_keys()) {}
  SettingsOptions settings;
  RunData run;
  std::string model, data, out, device, effects, only = "all", splats;
  double bound = -1, max_loss_db = 0.05, megabytes = 0;
  bool lossless = false, details = false, json = false, quiet = false, overwrite = false;

  bool searches() const { return !lossless && bound < 0 && splats.empty() && megabytes == 0; }
};

bool has_views(const Dataset& data, const char* name) {
  const Split* split = data.find(name);
  return split && !split->views.empty();
}

// Session contains the data, the device and the original model. The views are those of the split train,
// followed by those of the split test.
class Session {
 public:
  explicit Session(const ReduceOptions& options)
      : options_(options),
        loaded_(open_model(options.model)),
        settings_(drawing_settings(options.settings, loaded_, options.model, options.run)),
        data_(open_dataset(options.run.opened, options.data, {"train", "test"}, settings_, Images::load)),
        train_(take(data_, "train")),
        test_(has_views(data_, "test") ? take(data_, "test") : Split{"test", {}}),
        device_(open_verified_device(options.device, drawing_use(loaded_.model, settings_, true))),
        render_(render_settings(settings_)),
        before_(*device_, loaded_.model, config()),
        renderer_(*device_, before_.stages()),
        targets_(*device_, kTargetBudgetBytes, static_cast<std::size_t>(settings_.image_cache_mb) << 20) {
    warn_skipped(data_.report);
    require_images(train_);
    cameras_ = cameras_of(train_);
    for (const Camera& camera : cameras_of(test_)) cameras_.push_back(camera);
    renderer_.set_cameras(cameras_);
    targets_.add(train_);
    targets_.add(test_);
  }

  const MixedModel& model() const { return loaded_.model; }
  const std::vector<std::string>& comments() const { return loaded_.comments; }
  const Split& train() const { return train_; }
  const Split& test() const { return test_; }
  double eps2d() const { return settings_.eps2d; }
  Device& device() { return *device_; }

  Contributions contributions() {
    note("measuring what each splat contributes to {} training views", train_.views.size());
    return measure_contributions(*device_, renderer_, before_, render_, train_.views.size());
  }
  Metrics quality(const DeviceGroups& model, Renderer& renderer, const Split& split) {
    return evaluate(*device_, model.stages(), renderer, model.view(), render_, split.views, targets_,
                    &split == &test_ ? static_cast<std::uint32_t>(train_.views.size()) : 0u);
  }
  double train_psnr() { return quality(before_, renderer_, train_).mean.psnr_channel_mean; }
  double train_psnr(const MixedModel& model) {
    const DeviceGroups groups(*device_, model, config());
    Renderer renderer(*device_, groups.stages());
    renderer.set_cameras(cameras_);
    return quality(groups, renderer, train_).mean.psnr_channel_mean;
  }

  // Measures the quality of both models. With `details`, also measures the quality on the training views, and
  // the times.
  void compare(const Reduced& reduced, ReductionReport& report, bool details) {
    const DeviceGroups after(*device_, reduced.model, config());
    Renderer renderer(*device_, after.stages());
    renderer.set_cameras(cameras_);
    for (const Split* split : {&train_, &test_}) {
      if (split->views.empty() || (split == &train_ && !details && !test_.views.empty())) continue;
      note("measuring the quality on {} {} views", split->views.size(), split->name);
      report.splits.push_back({split->name, split->views.size(), quality(before_, renderer_, *split).mean,
                               quality(after, renderer, *split).mean});
    }
    if (!details) return;
    note("measuring the times");
    report.times = measure_times(*device_, {TimedModel{&before_, &renderer_}, {&after, &renderer}}, render_,
                                 train_.views.size(), targets_, std::min(kTimedViews, train_.views.size()));
  }

  template <typename... Args>
  void note(fmt::format_string<Args...> format, Args&&... args) const {
    if (!options_.quiet) remark("ubs: {} ...\n", fmt::format(format, std::forward<Args>(args)...));
  }

 private:
  Split take(Dataset& data, const char* name) {
    Split split = take_split(data, name);
    if (data.offset != loaded_.offset) rebase(split.views, data.offset, loaded_.offset);
    if (!settings_.run_cameras.empty()) use_run_cameras(settings_.run_cameras, split, loaded_.offset);
    for (const SplatModel& group : loaded_.model.groups) check_query(split, group.dim);
    if (split.name == "test") std::erase_if(split.views, [](const View& view) { return !view.has_image(); });
    return split;
  }
  KernelConfig config() const { return config_for(*device_, loaded_.model, settings_, false, true); }

  const ReduceOptions& options_;
  LoadedModel loaded_;
  TrainSettings settings_;
  Dataset data_;
  Split train_, test_;
  std::unique_ptr<Device> device_;
  RenderSettings render_;
  DeviceGroups before_;
  Renderer renderer_;
  TargetImages targets_;
  std::vector<Camera> cameras_;
};

ReduceChoice choice_of(const ReduceOptions& options) {
  return {.splats = options.only != "dimensions",
          .dimensions = options.only != "splats" && options.splats.empty()};
}

std::size_t wanted_splats(const ReduceOptions& options) {
  const std::optional<double> wanted = parse_whole(options.splats);
  if (!wanted || *wanted < 1)
    fail(ErrorKind::usage, "--splats {}: expected a whole number from 1, such as 20000 or 20k",
         options.splats);
  return static_cast<std::size_t>(*wanted);
}

// Returns the bound that keeps the `wanted` splats with the largest contributions. Splats with the same
// contribution are either all kept or all removed.
double bound_for_splats(const Contributions& contributions, std::size_t wanted) {
  std::vector<float> most = contributions.most;
  if (wanted >= most.size()) return 0;
  const auto first_removed = most.begin() + static_cast<std::ptrdiff_t>(wanted);
  std::ranges::nth_element(most, first_removed, std::greater<>());
  return *first_removed;
}

// Returns the smallest bound that leaves a file of at most the wanted size.
double bound_for_bytes(const ReduceOptions& options, const Reducer& reducer,
                       std::span<const std::string> comments) {
  const auto bytes_for = [&](double bound) {
    return static_cast<double>(mixed_ply_bytes(reducer.reduce(bound, choice_of(options)).model, comments));
  };
  const auto fits = [&](double bound) { return bytes_for(bound) <= options.megabytes * kMegabyte; };
  if (fits(0)) return 0;
  double low = 1e-9, high = 1;
  if (!fits(high))
    fail(ErrorKind::data,
         "--size {:g} cannot be reached: after removing all possible {}, the file still has {:.3f} MB",
         options.megabytes, options.only == "all" ? "splats and dimensions" : options.only,
         bytes_for(high) / kMegabyte);
  for (int i = 0; i < kSizeSteps; ++i) {
    const double middle = std::sqrt(low * high);
    (fits(middle) ? high : low) = middle;
  }
  return high;
}

// Returns the largest bound in the range whose loss on the training views is at most the allowed one, or 0
// if there is none. The bound is found by bisection of its logarithm.
double search_bound(const ReduceOptions& options, Session& session, const Reducer& reducer,
                    std::vector<SearchStep>& steps) {
  const double before = session.train_psnr();
  double allowed = 0, low = kMinBound, high = kMaxBound;
  for (int i = 0; i < kSearchSteps; ++i) {
    const double bound = std::sqrt(low * high);
    const Reduced reduced = reducer.reduce(bound, choice_of(options));
    const double loss = before - session.train_psnr(reduced.model);
    steps.push_back({bound, loss, reduced.model.parameters()});
    session.note("weight bound {:.4g}: {} splats remain, PSNR falls by {:.3f} dB", bound,
                 reduced.model.count(), loss);
    if (loss <= options.max_loss_db)
      allowed = low = bound;
    else
      high = bound;
  }
  return allowed;
}

void check(const ReduceOptions& options) {
  const int chosen =
      options.lossless + (options.bound >= 0) + !options.splats.empty() + (options.megabytes > 0);
  if (chosen > 1) fail(ErrorKind::usage, "--lossless, --bound, --splats and --size cannot be combined");
  if (!options.splats.empty()) {
    wanted_splats(options);
    if (options.only == "dimensions")
      fail(ErrorKind::usage, "--splats removes splats: --only dimensions cannot be combined with it");
  }
  check_output_files({options.out, options.effects}, {options.model, options.data}, options.overwrite);
  check_extension(options.out, "a UBS model", {".ply"});
  check_splat_name(options.out);
  check_extension(options.effects, "CSV", {".csv"});
}

int run(ReduceOptions& options) {
  files_before_output();
  options.run = use_run_data(options.model, options.data, options.settings.resolve());
  check(options);
  Session session(options);
  const MixedModel& model = session.model();
  if ((!Slicer::knows(model.variant()) || model.variant().direct()) && options.only != "splats")
    warn(
        "only splats are removed, because removing dimensions requires a model of the published variant "
        "({})",
        to_string(model.variant()));
  const Contributions contributions = session.contributions();
  session.note("measuring the effect of the dimensions of {} splats", model.count());
  const std::vector<Camera> train_cameras = cameras_of(session.train());
  const double worst = options.lossless ? 0 : options.bound >= 0 ? options.bound : kMaxBound;
  const Reducer reducer(model, train_cameras, contributions, session.eps2d(), worst);

  ReductionReport report;
  report.before = &model;
  report.reducer = &reducer;
  if (options.bound >= 0) report.bound = options.bound;
  if (!options.splats.empty()) report.bound = bound_for_splats(contributions, wanted_splats(options));
  if (options.megabytes > 0) report.bound = bound_for_bytes(options, reducer, session.comments());
  if (options.searches()) report.bound = search_bound(options, session, reducer, report.search);
  const Reduced reduced = reducer.reduce(report.bound, choice_of(options));
  if (reduced.model.count() == 0)
    fail(ErrorKind::data,
         "no splat would remain, because no splat has a weight above the bound {} in the training views: use "
         "a smaller bound",
         report.bound);
  report.after = &reduced;
  session.compare(reduced, report, options.details || options.json);

  write_mixed_ply(options.out, reduced.model, session.comments());
  report.bytes_before = fs::file_size(options.model);
  report.bytes_after = fs::file_size(options.out);
  if (!options.effects.empty()) write_file_atomically(options.effects, effects_csv(report));
  if (options.json) {
    Json json{{"version", version()},
              {"build", build_id()},
              {"model", options.model},
              {"data", options.data},
              {"out", options.out},
              {"only", options.only},
              {"device", device_json(session.device().info())}};
    if (options.searches()) json["max_loss_db"] = options.max_loss_db;
    json.update(to_json(report));
    print_json(json);
    return 0;
  }
  if (options.details) print_table(report);
  print_summary(report, options.out);
  return 0;
}

}  // namespace

Command add_reduce(CLI::App& root) {
  CLI::App* app =
      root.add_subcommand("reduce", "Remove splats and dimensions that the training views do not need");
  const auto options = std::make_shared<ReduceOptions>(*app);
  add_model_option(*app, "model,--model", options->model)->required();
  app->add_option("data,--data", options->data, kRunDataHelp)->type_name("DIR|FILE");
  app->add_option("--out", options->out,
                  "file for the reduced model; it has one group for each number of dimensions N")
      ->required()
      ->type_name("FILE");
  CLI::Option* loss = app->add_option("--max-loss-db", options->max_loss_db,
                                      "without --splats and --size: largest allowed loss of PSNR on the "
                                      "training views, in dB [0.05]")
                          ->check(from_to(0.0, 100.0))
                          ->type_name("DB");
  app->add_option("--splats", options->splats, "keep at most this many splats, such as 20000 or 20k")
      ->type_name("N")
      ->excludes(loss);
  app->add_option("--size", options->megabytes, "maximum size of the file, in MB (10^6 bytes)")
      ->check(positive())
      ->type_name("MB")
      ->excludes(loss);
  app->add_option("--bound", options->bound,
                  "instead of --max-loss-db: largest allowed change of a splat's weight in a pixel, 0 to 1 "
                  "(0: lossless)")
      ->check(from_to(0.0, 1.0))
      ->excludes(loss)
      ->type_name("B");
  app->add_flag("--lossless", options->lossless,
                "remove only splats and dimensions that do not change the images of the training views")
      ->excludes(loss);
  app->add_option("--only", options->only, "remove only splats, or only dimensions [all]")
      ->check(CLI::IsMember({"all", "splats", "dimensions"}))
      ->type_name("WHAT");
  app->add_option("--effects", options->effects,
                  "write the contributions of each splat and of its dimensions to this CSV file")
      ->type_name("FILE");
  app->add_flag("--details", options->details, "also measure training views and times, and print a table");
  add_device_option(*app, options->device);
  app->add_flag("--quiet", options->quiet, "do not print progress");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
