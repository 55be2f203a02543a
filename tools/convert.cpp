// SPDX-License-Identifier: Apache-2.0
// ubs convert: converts model files between formats. Importing into the ubs format is exact. Exporting
// models of Gaussians is exact except for the rounding of some formats. Exporting other models fixes the
// time, averages over the directions, and fits the result to renders of the model. The loss of quality is
// measured by rendering both models. The images are compared with each other, and with --data also with the
// images of the data.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/base/paths.hpp"
#include "host/device/registry.hpp"
#include "host/formats/gaussian_model.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/reduce_splats.hpp"
#include "host/formats/splat_file.hpp"
#include "host/formats/splat_series.hpp"
#include "host/model/camera_path.hpp"
#include "host/model/distill.hpp"
#include "host/model/export_model.hpp"
#include "host/model/scene_frame.hpp"
#include "host/run/open_data.hpp"
#include "host/run/verified_device.hpp"
#include "host/scene/conditioning.hpp"
#include "host/train/evaluate.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/path_options.hpp"
#include "tools/convert_loss.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

// Maximum number of viewpoints for the average over directions; more make no visible difference.
constexpr std::size_t kMaxViewpoints = 64;
constexpr int kMaxSeries = 1000;    // maximum number of time samples
constexpr double kFitSeconds = 30;  // default of --distill
constexpr int kPathCameras = 48;    // number of cameras on a path, used for fitting without data
// If --distill is not given, the fit is skipped if its minimum number of iterations takes longer than this.
constexpr double kMaxFitSeconds = 3 * kFitSeconds;
constexpr double kGoodExport = 40;  // PSNR below which advice is given [dB]

struct ConvertOptions {
  explicit ConvertOptions(CLI::App& app) : settings(app, drawing_keys()) {}
  SettingsOptions settings;
  std::string from, to, format = "auto", data, split = "test", device, opacity = "mean", distill = "auto",
                        conditioning;
  double time = 0;
  int degree = 3, series = 0;
  bool json = false, overwrite = false, no_measure = false;
  CLI::Option *split_option = nullptr, *time_option = nullptr, *opacity_option = nullptr,
              *degree_option = nullptr;
  RunData run;
  std::string camera_data;  // data whose training cameras are used: --data, or the data of the run
  bool split_given() const { return split_option->count() > 0; }
  bool fit_requested() const { return distill != "auto" && fit_seconds() > 0; }
  double fit_seconds() const {
    if (distill == "auto") return kFitSeconds;
    return distill == "0" ? 0 : parse_duration(distill, "--distill");
  }
};

const SplatFormat& target_format(const ConvertOptions& options, const SplatFormat& source) {
  if (options.format != "auto") return splat_format(options.format);
  const SplatFormat* format = format_of_extension(options.to);
  if (!format)
    fail(ErrorKind::usage, "{}: no format has the extension '{}': choose one with --to", options.to,
         small_extension(options.to));
  if (!format->ours() || !options.conditioning.empty()) return *format;
  // The ubs format and 3DGS both have the extension .ply. The default is 3DGS, which other programs read.
  // Files that are 3DGS already, and files of Beta splats (DBS), are converted to the ubs format.
  const bool gaussians = source.holds == SplatFormat::Holds::gaussians && source.name != "3dgs";
  return source.ours() || gaussians ? splat_format("3dgs") : *format;
}

// Returns the mean PSNR (of the channels) over the views of the split.
double measure(const ConvertOptions& options, const MixedModel& model, const std::array<double, 3>& offset,
               TrainSettings settings, std::optional<double> eps2d) {
  if (eps2d) settings.eps2d = *eps2d;
  const Split split =
      open_split_for(offset, options.data, options.split, settings, Images::load, options.run.opened);
  require_images(split);
  ModelSession session(options.device, model, split, settings, false);
  TargetImages targets(session.device(), kTargetBudgetBytes,
                       static_cast<std::size_t>(settings.image_cache_mb) << 20);
  targets.add(split);
  return evaluate(session.device(), session.stages(), session.renderer(), session.model().view(),
                  session.settings(), split.views, targets, 0)
      .mean.psnr_channel_mean;
}

std::vector<std::array<double, 3>> viewpoints(const ConvertOptions& options, const LoadedModel& loaded,
                                              const TrainSettings& settings) {
  std::vector<std::array<double, 3>> places;
  if (options.camera_data.empty()) {
    for (const Camera& camera : loaded.notes.cameras) places.push_back(camera.centre());
    return places;
  }
  Dataset data = open_dataset(options.run.opened, options.camera_data, {}, settings, Images::skip);
  Split train = take_split(data, data.find("train") ? "train" : options.split);
  rebase(train.views, data.offset, loaded.offset);
  const std::size_t step = (train.views.size() + kMaxViewpoints - 1) / kMaxViewpoints;
  for (std::size_t i = 0; i < train.views.size(); i += step) places.push_back(train.views[i].camera.centre());
  return places;
}

// Returns the file of a time sample of a series. The number of the sample is inserted before the extension. A
// format that stores several time samples has one file for all.
std::string file_of(const ConvertOptions& options, const SplatFormat& format, int moment) {
  if (options.series == 0 || format.write_series) return options.to;
  const fs::path to = options.to;
  return (to.parent_path() / fmt::format("{}-{:03}{}", to.stem().string(), moment, to.extension().string()))
      .string();
}

// Returns advice for an export that has lost much quality.
std::string advice(const ConvertOptions& options, const MixedModel& model) {
  if (!loses_in_closed_form(model))
    return "choose .ply or .glb, which store the numbers of these Gaussians exactly";
  return fmt::format(
      "fit longer (--distill {}), or train with --dim 3 --kernel gaussian --colour sh3 for a model "
      "that exports without loss",
      options.fit_seconds() < 60 ? "60s" : "5m");
}

constexpr const char* kNotFitted = "the Gaussians were not fitted to the model";

// Calls `work`. If it fails because of this machine, for example because there is no usable device or not
// enough memory, adds a remark that begins with `what`. Other errors are passed on.
template <typename Work>
void if_possible(const char* what, std::vector<std::string>& remarks, const Work& work) {
  try {
    work();
  } catch (const Error& error) {
    const ErrorKind kind = error.kind();
    if (kind != ErrorKind::device && kind != ErrorKind::build && kind != ErrorKind::memory &&
        kind != ErrorKind::faulty && kind != ErrorKind::numerical)
      throw;
    remarks.push_back(fmt::format("{}: {}", what, error.what()));
  }
}

// Measures the loss of quality of an export that is not exact, and adds it to `json`. `closed_form` are the
// splats before they were fitted.
void add_loss(const ConvertOptions& options, const SplatFormat& format, const LoadedModel& loaded,
              const std::optional<ImportedSplats>& closed_form, const TrainSettings& settings, Json& json) {
  if (options.no_measure || options.series > 0 || exports_exactly(format, loaded.model)) return;
  std::vector<std::string> remarks;
  if_possible("the loss of quality was not measured", remarks, [&] {
    LossMeter meter(options.device, loaded, settings, options.time);
    if (meter.cameras() == 0) return;
    const ExportLoss loss = meter.measure(exact_model(read_foreign_splats(options.to)));
    json["loss"] = {{"psnr", loss.own}, {"psnr_on_black", loss.black}, {"cameras", meter.cameras()}};
    if (closed_form && json.contains("distilled"))
      json["loss"]["psnr_without_fit"] = meter.measure(exact_model(*closed_form)).own;
    if (std::min(loss.own, loss.black) < kGoodExport) json["loss"]["advice"] = advice(options, loaded.model);
  });
  for (std::string& remark : remarks) json["remarks"].push_back(std::move(remark));
}

void report(const ConvertOptions& options, const SplatFormat& format, const Json& json) {
  if (options.json) return print_json(json);
  for (const auto& remark : json["remarks"]) say("{}\n", remark.get<std::string>());
  if (json.contains("psnr_before"))
    say("quality  PSNR {:.2f} dB before, {:.2f} dB after the conversion: {:+.2f} dB on the images of '{}'\n",
        json["psnr_before"].get<double>(), json["psnr_after"].get<double>(),
        json["psnr_after"].get<double>() - json["psnr_before"].get<double>(), options.split);
  if (json.contains("loss")) {
    const Json& loss = json["loss"];
    say("quality  PSNR against the model: {:.2f} dB{} with its own background, {:.2f} dB with a black one "
        "(mean of {} cameras)\n",
        loss["psnr"].get<double>(),
        loss.contains("psnr_without_fit")
            ? fmt::format(" ({:.2f} dB without the fit)", loss["psnr_without_fit"].get<double>())
            : "",
        loss["psnr_on_black"].get<double>(), loss["cameras"].get<std::size_t>());
    if (loss.contains("advice")) say("         {}\n", loss["advice"].get<std::string>());
  }
  if (json.contains("psnr"))
    say("PSNR {:.2f} dB on '{}' with eps2d {:.4g}\n", json["psnr"].get<double>(), options.split,
        json["eps2d"].get<double>());
  const std::string first = file_of(options, format, 0);
  const std::string moments =
      json.contains("moments") ? fmt::format(" at {} time samples", json["moments"].get<std::size_t>()) : "";
  say("{} splats{} in {} ({}, {:.2f} MiB)\n", json["splats"].get<std::size_t>(), moments,
      first != options.to ? first + " ..." : first, json["to"].get<std::string>(),
      json["bytes"].get<double>() / (1 << 20));
}

// Returns the options for reduce_splats(). Directions are averaged over the viewpoints of the data or,
// without data, of the cameras that the model lists. Models of Gaussians need no viewpoints.
ReduceOptions reduction(const ConvertOptions& options, const LoadedModel& loaded,
                        const TrainSettings& settings) {
  ReduceOptions reduction{.time = options.time, .opacity = options.opacity, .viewpoints = {}};
  if (!std::ranges::all_of(loaded.model.groups, is_gaussian_model))
    reduction.viewpoints = viewpoints(options, loaded, settings);
  return reduction;
}

[[noreturn]] void refuse_degree() {
  fail(ErrorKind::usage, "--degree requires that the Gaussians are fitted to the model: pass --distill TIME");
}

// Returns whether the export is fitted to renders of the model.
bool fits(const ConvertOptions& options, const MixedModel& model) {
  if (options.distill == "auto" && options.series > 0) return false;  // each sample would need its own fit
  return options.fit_requested() || (options.fit_seconds() > 0 && loses_in_closed_form(model));
}

// Finds the training cameras of the run, unless --data names others. Missing data are only an error if
// --distill was given and the model lists no cameras.
void find_cameras(ConvertOptions& options, const LoadedModel& loaded) {
  if (!options.data.empty() || !loses_in_closed_form(loaded.model)) return;
  try {
    options.run = use_run_data(options.from, options.camera_data, options.settings.resolve());
  } catch (const std::exception& exception) {
    const ErrorKind kind = as_error(exception).kind();
    if (kind != ErrorKind::usage && kind != ErrorKind::data) throw;
    if (options.fit_requested() && loaded.notes.cameras.empty()) throw;
  }
}

// Returns the few cameras that the model lists and, because these alone show too little, cameras on a path
// between them.
std::vector<Camera> cameras_to_fit(const LoadedModel& loaded) {
  std::vector<Camera> cameras = noted_cameras(loaded.model, loaded.notes.cameras);
  if (cameras.size() < 2) return cameras;
  const Camera& first = cameras.front();
  const Canvas canvas{first.width, first.height, first.extra};
  const std::unique_ptr<CameraPath> path = walk_path(cameras, pose_of(first).fov);
  for (const double u : path_moments(kPathCameras, path->closed()))
    cameras.push_back(camera_at(path->at(u), canvas));
  return cameras;
}

// Opens the distiller with the training cameras of the data or, if there are none, with the cameras that the
// model lists. If that is not possible and the fit was not requested, adds a remark instead.
void open_distiller(const ConvertOptions& options, const SplatFormat& format, const LoadedModel& loaded,
                    const TrainSettings& settings, std::optional<Distiller>& distiller,
                    std::vector<std::string>& remarks) {
  Split views{.name = "cameras of the model", .views = {}};
  if (!options.camera_data.empty())
    views = open_split_for(loaded.offset, options.camera_data, "train", settings, Images::skip,
                           options.run.opened);
  else
    for (const Camera& camera : cameras_to_fit(loaded))
      views.views.push_back({.name = "camera", .camera = camera});
  if (views.views.empty()) {
    remarks.push_back(fmt::format("{}, because it lists no cameras: pass the data with --data", kNotFitted));
    return;
  }
  for (const SplatModel& group : loaded.model.groups) check_query(views, group.dim);
  const auto open = [&] {
    distiller.emplace(open_verified_device(options.device, drawing_use(loaded.model, settings, true)),
                      loaded.model, settings, std::move(views), std::min(options.degree, format.degree));
  };
  if (options.fit_requested())
    open();
  else
    if_possible(kNotFitted, remarks, open);
}

// Fits the splats of a time sample, unless this takes too long.
ImportedSplats fitted(const ConvertOptions& options, Distiller& distiller, double time,
                      const ImportedSplats& splats, std::vector<std::string>& said, Json& json) {
  const double seconds = options.fit_seconds() / std::max(1, options.series);
  bool declined = false;
  const Distilled distilled = distiller.at(time, splats, seconds, [&](const DistillPlan& plan) {
    const bool least = plan.iterations == kMinIterations;
    declined = !options.fit_requested() && least && plan.seconds > kMaxFitSeconds;
    if (declined)
      said.push_back(
          fmt::format("{}, because {} iterations, the minimum, take about {:.0f} s: pass --distill {:.0f}s",
                      kNotFitted, kMinIterations, plan.seconds, std::ceil(plan.seconds)));
    else
      remark(
          "ubs: fitting {} Gaussians to {} renders of the model: {} iterations{} in about {:.0f} s "
          "(--distill)\n",
          splats.count(), plan.renders, plan.iterations, least ? ", the minimum," : "", plan.seconds);
    return !declined;
  });
  if (declined) return splats;
  const bool better = distilled.after > distilled.before;
  said.push_back(fmt::format(
      "fitted to renders of the model in {:.1f} s, {} iterations{}", distilled.seconds, distilled.iterations,
      better ? "" : ", which did not improve the Gaussians, so they were not changed"));
  if (options.series > 0 || options.no_measure)
    said.back() += fmt::format(": PSNR {:.2f} -> {:.2f} dB", distilled.before, distilled.after);
  json["distilled"].push_back({{"time", time},
                               {"seconds", distilled.seconds},
                               {"iterations", distilled.iterations},
                               {"psnr_before", distilled.before},
                               {"psnr_after", distilled.after}});
  return distilled.splats;
}

void add_remarks(std::vector<std::string>& remarks, std::vector<std::string> more) {
  for (std::string& remark : more)
    if (std::ranges::find(remarks, remark) == remarks.end()) remarks.push_back(std::move(remark));
}

// Exports several time samples of a dynamic model, as several files or as one. Splat i is the same splat at
// all time samples.
Json export_series(const ConvertOptions& options, const SplatFormat& format, const LoadedModel& loaded,
                   ReduceOptions reduce, std::optional<Distiller>& distiller,
                   std::vector<std::string>& remarks) {
  Json json = Json::object();
  remarks.push_back(
      fmt::format("{} time samples from time 0 to 1; rule for the opacity over all view directions: {}",
                  options.series, options.opacity));
  // Splats that are invisible at some times are kept until all time samples are known.
  const float least_opacity = reduce.least_opacity;
  reduce.least_opacity = 0;
  const auto time_of = [&](std::size_t moment) {
    return static_cast<double>(moment) / (options.series - 1.0);
  };
  SplatSeries series;
  for (std::size_t moment = 0; moment < static_cast<std::size_t>(options.series); ++moment) {
    reduce.time = time_of(moment);
    std::vector<std::string> said;
    series.add(exported_splats(format, loaded.model, loaded.offset, reduce, said));
    std::erase_if(said, [](const std::string& remark) { return remark.starts_with("exported for time "); });
    add_remarks(remarks, std::move(said));
    const ImportedSplats& first = series.moments().front();
    if (moment == 0)  // a position, a rotation, three scales and an opacity
      require_memory(44 * first.count() * static_cast<std::size_t>(options.series - 1),
                     fmt::format("{} time samples of {} splats", options.series, first.count()));
  }
  const bool corresponds = series.finish(least_opacity);
  if (distiller) {
    SplatSeries trained;
    for (std::size_t moment = 0; moment < series.size(); ++moment)
      trained.add(fitted(options, *distiller, time_of(moment), series.moment(moment), remarks, json));
    series = std::move(trained);
  }
  if (!corresponds)
    remarks.emplace_back(
        "the time samples have different numbers of splats, because some cannot be rendered at all times");
  add_remarks(remarks, format_remarks(format, series.moments().front()));
  if (!format.write_series) {
    json["splats"] = std::size_t{0};
    for (std::size_t moment = 0; moment < series.size(); ++moment) {
      ImportedSplats splats = series.moment(moment);
      splats.keep_order = true;
      write_foreign_splats(format, file_of(options, format, static_cast<int>(moment)), splats);
      json["splats"] = json["splats"].get<std::size_t>() + splats.count();
    }
    return json;
  }
  // Time samples that were trained separately must not be interpolated.
  if (distiller || !corresponds) {
    series.keep_apart();
    remarks.emplace_back(
        "the splats of different time samples do not correspond, so other programs show each time sample "
        "until the next one");
  }
  format.write_series(options.to, series);
  json["splats"] = series.largest_count();
  json["moments"] = series.size();
  return json;
}

// Exports a static model, or one or several time samples of a dynamic model. If the splats are fitted,
// `closed_form` receives the splats of a single time sample before the fit.
Json export_gaussians(const ConvertOptions& options, const SplatFormat& format, const LoadedModel& loaded,
                      const TrainSettings& settings, std::optional<ImportedSplats>& closed_form) {
  const MixedModel& model = loaded.model;
  if (!model.has_time() && (options.series > 0 || options.time_option->count() > 0))
    fail(ErrorKind::usage, "{}: --time and --series require a model that depends on time", options.from);
  warn_of_other_times(fmt::format("{}", options.time), {&options.time, 1});
  const ReduceOptions reduce = reduction(options, loaded, settings);
  std::vector<std::string> remarks = loaded.remarks;
  std::optional<Distiller> distiller;
  if (fits(options, model))
    open_distiller(options, format, loaded, settings, distiller, remarks);
  else if (options.degree_option->count() > 0)
    refuse_degree();
  if (options.series > 0) {
    Json json = export_series(options, format, loaded, reduce, distiller, remarks);
    json["remarks"] = remarks;
    return json;
  }
  Json json = Json::object();
  if (format.write_series && model.has_time())
    remarks.emplace_back(
        "the model depends on time, but the file contains only one time sample: store K of them with "
        "--series K");
  ImportedSplats splats = exported_splats(format, model, loaded.offset, reduce, remarks);
  if (distiller) {
    closed_form = splats;
    const auto fit = [&] { splats = fitted(options, *distiller, reduce.time, *closed_form, remarks, json); };
    if (options.fit_requested())
      fit();
    else
      if_possible(kNotFitted, remarks, fit);
  }
  add_remarks(remarks, format_remarks(format, splats));
  write_foreign_splats(format, options.to, splats);
  json["splats"] = splats.count();
  json["remarks"] = remarks;
  return json;
}

// Converts the model to the other kind of conditioning, and measures the loss of quality if there are data.
Json recondition(const ConvertOptions& options, const LoadedModel& loaded, const TrainSettings& settings) {
  MixedModel model{std::vector<SplatModel>{}};
  std::size_t indefinite = 0;
  double opacity_mean = 0, opacity_most = 0;
  for (const SplatModel& group : loaded.model.groups) {
    Reconditioned part = options.conditioning == "direct" ? to_direct(group) : to_covariance(group);
    indefinite += part.indefinite;
    opacity_mean +=
        part.opacity_mean * static_cast<double>(group.count) / static_cast<double>(loaded.model.count());
    opacity_most = std::max(opacity_most, part.opacity_most);
    model.groups.push_back(std::move(part.model));
  }
  write_mixed_ply(options.to, model, loaded.comments);
  Json json{{"splats", model.count()},
            {"variant", to_string(model.variant())},
            {"indefinite", indefinite},
            {"opacity_change_mean", opacity_mean},
            {"opacity_change_most", opacity_most},
            {"remarks", loaded.remarks}};
  if (opacity_most > 0)
    json["remarks"].push_back(fmt::format("opacity changes by {:.2g} on average and by at most {:.2g}",
                                          opacity_mean, opacity_most));
  if (indefinite > 0)
    json["remarks"].push_back(
        fmt::format("{} splats that were culled from some directions are now rendered from all", indefinite));
  if (options.data.empty()) return json;
  json["psnr_before"] = measure(options, loaded.model, loaded.offset, settings, {});
  json["psnr_after"] = measure(options, model, loaded.offset, settings, {});
  return json;
}

void require_splats(std::size_t count, const std::string& file) {
  if (count == 0)
    fail(ErrorKind::data, "{}: the file contains no splats, so there is nothing to convert", file);
}

Json export_model(ConvertOptions& options, const SplatFormat& format) {
  const LoadedModel loaded = load_splat_model(options.from);
  require_splats(loaded.model.count(), options.from);
  if (!format.ours()) find_cameras(options, loaded);
  const MixedModel& model = loaded.model;
  const std::array<double, 3>& offset = loaded.offset;
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.from, options.run);
  if (!options.conditioning.empty()) return recondition(options, loaded, settings);
  if (format.ours()) {
    write_mixed_ply(options.to, model, loaded.comments);
    return {{"splats", model.count()}, {"remarks", loaded.remarks}};
  }
  std::optional<ImportedSplats> closed_form;
  Json json = export_gaussians(options, format, loaded, settings, closed_form);
  const Background& behind = settings.background;
  if (behind != Background{})
    json["remarks"].push_back(fmt::format(
        "the model was trained with {} {}, which this format does not store: other programs use black or "
        "their own background",
        behind.harmonics.empty() ? "the background" : "a sky of mean colour", fmt::join(behind.colour, ",")));
  add_loss(options, format, loaded, closed_form, settings, json);
  if (options.data.empty() || options.series > 0) return json;
  // Compare with the written file, including its quantisation, rendered as other tools render it.
  const SplatModel written = exact_model(read_foreign_splats(options.to));
  json["psnr_before"] = measure(options, model, offset, settings, {});
  json["psnr_after"] = measure(options, written, offset, settings, kGaussianBlur);
  return json;
}

Json import_model(const ConvertOptions& options, const SplatFormat& format) {
  const TrainSettings settings = options.settings.resolve();
  std::optional<double> time;
  if (options.time_option->count() > 0) time = options.time;
  if (!format.ours()) {
    const ImportedSplats splats = read_foreign_splats(options.from, time);
    require_splats(splats.count(), options.from);
    write_foreign_splats(format, options.to, splats);
    std::vector<std::string> remarks = read_remarks(splats);
    for (std::string& remark : format_remarks(format, splats)) remarks.push_back(std::move(remark));
    return {{"splats", splats.count()}, {"remarks", remarks}};
  }
  const LoadedModel loaded = load_splat_model(options.from, time);
  const SplatModel& model = loaded.model.groups.front();
  require_splats(model.count, options.from);
  write_splat_ply(options.to, model, loaded.comments);
  Json json{{"splats", model.count}, {"variant", to_string(model.variant)}, {"remarks", loaded.remarks}};
  if (options.data.empty()) return json;
  json["psnr"] = measure(options, model, loaded.offset, settings, {});
  json["eps2d"] = settings.eps2d;
  return json;
}

std::vector<fs::path> files_of(const ConvertOptions& options, const SplatFormat& format) {
  if (format.write_series) return {options.to};
  std::vector<fs::path> files;
  for (int moment = 0; moment < std::max(1, options.series); ++moment)
    files.emplace_back(file_of(options, format, moment));
  return files;
}

int run(ConvertOptions& options) {
  files_before_output();
  if (!std::isfinite(options.time))
    fail(ErrorKind::usage, "--time {}: must be a finite number", options.time);
  // fit_seconds() throws for an invalid time.
  if (options.fit_seconds() == 0 && options.degree_option->count() > 0) refuse_degree();
  if (options.fit_requested()) choose_device(list_devices(), options.device);
  using Holds = SplatFormat::Holds;
  const SplatFormat& source = detect_splat_format(options.from);
  check_splat_name(options.to);
  const SplatFormat& format = target_format(options, source);
  const bool exports = source.ours() && format.holds == Holds::gaussians;
  if ((options.distill != "auto" || options.series > 0) && !exports)
    fail(ErrorKind::usage, "--distill and --series only apply when exporting a ubs model as Gaussians");
  if (options.degree_option->count() > 0 && !exports) refuse_degree();
  if (!options.conditioning.empty() && !(source.ours() && format.ours()))
    fail(ErrorKind::usage, "--conditioning only applies when converting a ubs model to a ubs model");
  if (source.holds == Holds::beta && format.holds == Holds::gaussians)
    fail(ErrorKind::usage,
         "{}: {} contains Beta splats, but {} stores Gaussians: convert it to a .ply file first, and that "
         "file to {}",
         options.from, source.title, format.title, format.name);
  if (source.holds == Holds::gaussians && format.holds == Holds::beta)
    fail(ErrorKind::usage, "{}: {} contains Gaussians, but {} stores Beta splats", options.from, source.title,
         format.title);
  const bool chooses_moment = source.read_at && options.time_option->count() > 0;
  if (chooses_moment && !(options.time >= 0 && options.time <= 1))
    fail(ErrorKind::usage,
         "--time {}: choose a time sample of the file with a number from 0 (first) to 1 (last)",
         options.time);
  if (!exports &&
      ((!chooses_moment && options.time_option->count() > 0) || options.opacity_option->count() > 0))
    fail(ErrorKind::usage, "--time and --opacity only apply when exporting a ubs model as Gaussians");
  if (options.split_given() && options.data.empty())
    fail(ErrorKind::usage, "--split requires --data: it selects the split that quality is measured on");
  const bool stays = source.ours() == format.ours() && options.conditioning.empty();
  if (stays && !options.data.empty())
    fail(ErrorKind::usage,
         "--data is not used here: quality is measured only between ubs and another format, or with "
         "--conditioning");
  options.camera_data = options.data;
  if (source.ours() && !options.data.empty())
    options.run = use_run_data(options.from, options.data, options.settings.resolve());
  check_output_files(files_of(options, format), {options.from, options.data}, options.overwrite);
  check_extension(options.to, std::string(format.title), {format.extension, format.second_extension});
  if (format.require_writer) format.require_writer();
  Json json = source.ours() ? export_model(options, format) : import_model(options, format);
  json["from"] = source.title;
  json["to"] = format.name;
  json["bytes"] = std::size_t{0};
  for (const fs::path& file : files_of(options, format))
    json["bytes"] = json["bytes"].get<std::size_t>() + fs::file_size(file);
  report(options, format, json);
  return 0;
}

}  // namespace

Command add_convert(CLI::App& root) {
  CLI::App* app = root.add_subcommand("convert", "Convert a model file to another format");
  const auto options = std::make_shared<ConvertOptions>(*app);
  add_model_option(*app, "from", options->from,
                   fmt::format("model file ({}), or output folder of 'ubs train'", splat_format_titles()))
      ->required()
      ->type_name("FROM");
  app->add_option("out", options->to, "file to write")->required()->type_name("TO");
  std::vector<std::string> formats = written_formats();
  const std::string names = fmt::format("{}", fmt::join(formats, ", "));
  formats.emplace_back("auto");
  app->add_option("--to", options->format,
                  names + " [chosen by the extension; .ply: ubs if FROM is a 3DGS or DBS file, else 3dgs]")
      ->check(CLI::IsMember(formats))
      ->type_name("FORMAT");
  options->time_option =
      app->add_option(
             "--time", options->time,
             "time at which a dynamic model is exported, or time sample of a USD file, from 0 to 1 [0]")
          ->type_name("T");
  options->opacity_option =
      app->add_option("--opacity", options->opacity,
                      "opacity of an exported splat: mean, weighted (opacity-weighted mean) or max, over all "
                      "view directions [mean]")
          ->check(CLI::IsMember({"mean", "weighted", "max"}))
          ->type_name("RULE");
  app->add_option("--data", options->data,
                  "data folder: measure the quality on its images, and use its training cameras to average "
                  "shapes and opacities that depend on the view direction")
      ->type_name("DIR");
  options->split_option =
      app->add_option("--split", options->split, "split to measure the quality on [test]")->type_name("NAME");
  app->add_option("--conditioning", options->conditioning,
                  "convert a ubs model to this kind of conditioning: direct or covariance (docs/method.md 9)")
      ->check(CLI::IsMember({"direct", "covariance"}))
      ->type_name("FORM");
  app->add_option(
         "--distill", options->distill,
         fmt::format("time for fitting the exported Gaussians to images that the model renders from the "
                     "training cameras, such as 60s or 5m; 0: no fit [{:.0f}s; 0 with --series, or if the "
                     "export does not change the model]",
                     kFitSeconds))
      ->type_name("TIME");
  options->degree_option = app->add_option("--degree", options->degree,
                                           "degree of the spherical harmonics of fitted Gaussians [3]")
                               ->check(from_to(0, 3))
                               ->type_name("K");
  app->add_option("--series", options->series,
                  "number of time samples from time 0 to 1, written as files TO-000, TO-001, ..., or into "
                  "one USD file; the time of --distill is divided among them")
      ->check(from_to(2, kMaxSeries))
      ->excludes("--time")
      ->type_name("K");
  app->add_flag("--no-measure", options->no_measure,
                "do not measure the loss of quality of an export (on cameras that the model lists)");
  add_device_option(*app, options->device);
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
