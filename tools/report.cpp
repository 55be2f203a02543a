// SPDX-License-Identifier: Apache-2.0
// ubs report: writes a self-contained HTML page about one training run, or about several side by side.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/device/registry.hpp"
#include "host/formats/splat_file.hpp"
#include "host/look/report/report_page.hpp"
#include "host/look/web/page.hpp"
#include "host/look/web/steps.hpp"
#include "host/run/open_data.hpp"
#include "host/run/run_cameras.hpp"
#include "host/run/same_run.hpp"
#include "host/run/verified_device.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/train/checkpoint.hpp"
#include "host/train/run_settings.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/program_version.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

struct ReportOptions {
  std::vector<std::string> runs;
  std::string out, data, device;
  int views = 3;
  bool allow_outside = false, json = false, no_viewer = false, overwrite = false;
};

// RunModel is the model of a run. A model file states the offset of its coordinates. For a model from a
// checkpoint, `offset` is empty, and its coordinates are relative to the offset that the loader of the data
// chooses.
struct RunModel {
  std::optional<MixedModel> model;
  std::optional<std::array<double, 3>> offset;
  std::string data, data_from_run;          // paths of the data that the run was trained on, if known
  std::optional<std::uint32_t> data_print;  // fingerprint() of these data
  LoadedModel loaded;                       // content of the model file, except for the model itself
};

// Returns the checkpoint of a run that has no model, or that was resumed after writing its model and then
// killed.
std::optional<Checkpoint> later_checkpoint(RunRecord& run) {
  if (!path_exists(run.checkpoint())) return {};
  const bool has_model = path_exists(run.model());
  try {
    Checkpoint checkpoint = read_checkpoint(run.checkpoint());
    if (has_model && checkpoint.state.iteration <= run.number({"iterations"}).value_or(HUGE_VAL)) return {};
    run.remarks.push_back(
        fmt::format("model.ply is {}: showing the model of the checkpoint at iteration {} instead",
                    has_model ? "older" : "missing", checkpoint.state.iteration));
    return checkpoint;
  } catch (const Error& error) {
    if (!has_model || error.kind() != ErrorKind::data) throw;
    run.remarks.push_back(fmt::format("the checkpoint is ignored: {}", error.what()));
    return {};
  }
}

RunModel open_run_model(RunRecord& run) {
  RunModel out;
  out.data = run.text({"data"});
  out.data_from_run = run.text({"data_from_run"});
  out.data_print = run.data_print();
  if (std::optional<Checkpoint> checkpoint = later_checkpoint(run)) {
    run.settings.background = learnt_background(checkpoint->settings.background, checkpoint->state.sky);
    scale_lengths(checkpoint->state.model, checkpoint->settings.unit);
    out.model = std::move(checkpoint->state.model);
    if (out.data.empty()) out.data = checkpoint->data, out.data_from_run = checkpoint->data_from_run;
    out.data_print = checkpoint->data_print;
  } else if (path_exists(run.model())) {
    LoadedModel loaded = load_splat_model(run.model());
    if (run.settings.background.learnt != Background::Learnt::no)
      run.settings.background = noted_settings(loaded.notes, run.model().string()).background;
    run.remarks.insert(run.remarks.end(), loaded.remarks.begin(), loaded.remarks.end());
    out.model = std::move(loaded.model);
    out.offset = loaded.offset;
    out.loaded = std::move(loaded);
  } else {
    run.remarks.push_back("model.ply is missing: the report has no images and no histograms");
  }
  return out;
}

struct Views {
  Split split;
  std::string data;   // path of the data
  bool same = false;  // cameras, names and images of the training views are those of the run
};

Views open_views(const RunModel& model, const fs::path& data, TrainSettings settings) {
  // Only a few of the images are needed, so they are decoded on demand.
  settings.image_cache_mb = 1;
  Dataset set = open_dataset(data, {"test", "train"}, settings, Images::load);
  const Split* test = set.find("test");
  const bool same = model.data_print && has_fingerprint(set, *model.data_print);
  Split split = take_split(set, test && !test->views.empty() ? "test" : "train");
  const std::array<double, 3> offset = model.offset.value_or(set.offset);
  if (offset != set.offset) rebase(split.views, set.offset, offset);
  if (same && !settings.run_cameras.empty()) use_run_cameras(settings.run_cameras, split, offset);
  for (const SplatModel& group : model.model->groups) check_query(split, group.dim);
  return {std::move(split), data.string(), same};
}

// Finds the views. If the data that the run names cannot be read or have been replaced by others, this is
// only a remark. If data that the user named cannot be read, this is an error. The run may come from anyone
// and name any folder, and the page may be passed on. Therefore the page shows images of a folder that the
// user has not named only if it contains the data of the run, and does not quote errors of its files.
std::optional<Views> find_views(RunRecord& run, const RunModel& model, const ReportOptions& options) {
  constexpr const char* kOthers =
      "{} is not the data that the run was trained on: cameras, names or images differ{}";
  TrainSettings settings = run.settings;
  settings.allow_outside = options.allow_outside;
  if (!options.data.empty()) {
    Views views = open_views(model, options.data, settings);
    if (!model.data_print)
      run.remarks.push_back(
          fmt::format("the run has no fingerprint of its data, so {} may contain other data", views.data));
    else if (!views.same)
      run.remarks.push_back(fmt::format(kOthers, options.data, ""));
    return views;
  }
  if (!model.data.empty() && !model.data_print) {
    run.remarks.push_back(fmt::format(
        "the run has no fingerprint of its data, so {} may contain other data and is not used (pass --data "
        "DIR to use it)",
        model.data));
    return {};
  }
  std::string why =
      model.data.empty()
          ? "the run does not state which data it was trained on (pass --data DIR)"
          : fmt::format("the data folder {} does not exist (choose another with --data DIR)", model.data);
  for (const fs::path& place : data_places(model.data, model.data_from_run, run.folder)) {
    if (!path_exists(place)) continue;
    try {
      Views views = open_views(model, place, settings);
      if (views.same) return views;
      why = fmt::format(kOthers, views.data, " (pass --data DIR to use it anyway)");
    } catch (const std::exception& exception) {
      const Error error = as_error(exception);
      if (error.kind() != ErrorKind::data) throw;
      warn("{}", error.what());
      why = fmt::format("the data in {} cannot be used (choose others with --data DIR)", place.string());
    }
  }
  run.remarks.push_back(why);
  return {};
}

// Returns the name of the view of the split with the lowest PSNR in the run, or "" if the run has not
// measured the split.
std::string worst_view(const RunRecord& run, const Split& split) {
  const auto* measured = run.find({"test", "views"});
  std::string worst;
  double least = HUGE_VAL;
  if (measured && measured->is_array() && split.name == "test")
    for (const auto& view : *measured)
      if (view.contains("psnr") && view["psnr"].is_number() && view["psnr"].get<double>() < least &&
          view.contains("name") && view["name"].is_string()) {
        least = view["psnr"].get<double>();
        worst = view["name"];
      }
  return worst;
}

// Returns the views with these names. If no names are given, returns evenly spaced views and replaces the
// last of them by the worst view, because a report without the worst view would be too favourable.
std::vector<View> chosen_views(const Split& split, const std::vector<std::string>& names,
                               const std::string& worst, int count) {
  std::vector<View> views;
  for (const std::string& name : names)
    for (const View& view : split.views)
      if (view.name == name) views.push_back(view);
  if (views.empty())
    for (const std::size_t i : evenly_spaced(split.views.size(), static_cast<std::size_t>(count)))
      views.push_back(split.views[i]);
  const auto is_worst = [&](const View& view) { return view.name == worst; };
  const auto found = std::ranges::find_if(split.views, is_worst);
  if (names.empty() && views.size() > 1 && found != split.views.end() &&
      std::ranges::none_of(views, is_worst))
    views.back() = *found;
  return views;
}

// Adds remarks about common causes of disappointing models.
void remark_on_splats(RunRecord& run, const MixedModel& model) {
  constexpr double kFar = 10;  // multiples of the extent
  const std::optional<double> extent = run.number({"extent"});
  // In a run with a time budget, ubs chooses the maximum, so it is normal that the model reaches it.
  if (model.count() >= static_cast<std::size_t>(run.settings.cap_max) && !run.number({"budget_seconds"}))
    run.remarks.push_back(
        fmt::format("the model has reached the maximum number of splats, --cap-max ({})", model.count()));
  if (!extent || !(*extent > 0)) return;
  std::array<std::vector<float>, 3> at;
  for (const SplatModel& group : model.groups)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto row = group.row(group.layout().xyz + static_cast<int>(k));
      at[k].insert(at[k].end(), row.begin(), row.end());
    }
  std::array<float, 3> middle{};
  for (std::size_t k = 0; k < 3; ++k) {
    std::vector<float> sorted = at[k];
    const auto half = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), half, sorted.end());
    middle[k] = *half;
  }
  std::size_t far = 0;
  for (std::size_t i = 0; i < at[0].size(); ++i)
    far += std::hypot(at[0][i] - middle[0], at[1][i] - middle[1], at[2][i] - middle[2]) > kFar * *extent;
  if (far > 0)
    run.remarks.push_back(
        fmt::format("{} of {} splats are more than {} extents away from the centre of the model: they are "
                    "distant surroundings, or floaters that at most one camera sees",
                    far, at[0].size(), kFar));
}

// Without cameras of the data, renders the model from cameras around it and adds the images that the run
// saved.
void draw_around(ReportRun& run, Device& device, int count) {
  constexpr int kSize = 320, kCircling = 2;
  constexpr double kTurn = 2.0;  // [rad] between consecutive cameras
  std::vector<View> views(kCircling);
  for (int k = 0; k < kCircling; ++k) {
    views[k].name = fmt::format("around the model {}", k + 1);
    views[k].camera = circling_camera(*run.model, 0.5 + kTurn * k, kSize, kSize);
  }
  run.drawings = draw_run(device, *run.model, run.record.settings, views);
  std::vector<DrawnView> saved =
      saved_renders(run.record.renders(), static_cast<std::size_t>(count), run.record.remarks);
  run.views_from = saved.empty()
                       ? "no ground truth: views from around the model"
                       : "images that the run saved at its end (renders/), without depth and alpha; and "
                         "views from around the model, without ground truth";
  saved.insert(saved.end(), std::make_move_iterator(run.drawings.views.begin()),
               std::make_move_iterator(run.drawings.views.end()));
  run.drawings.views = std::move(saved);
}

void draw(ReportRun& run, const RunModel& model, ReportOptions& options, std::shared_ptr<Device>& device,
          std::vector<std::string>& names) {
  const std::optional<Views> found = find_views(run.record, model, options);
  // All runs use one device, which is verified for the variant of each run.
  options.device =
      verified_request(options.device, drawing_use(*run.model, run.record.settings, !options.no_viewer));
  if (!device) device = open_device(options.device);
  run.drawn_on = describe(device->info());
  if (!found) return draw_around(run, *device, options.views);
  const std::string worst = worst_view(run.record, found->split);
  const std::vector<View> views = chosen_views(found->split, names, worst, options.views);
  const bool has_worst = std::ranges::any_of(views, [&](const View& view) { return view.name == worst; });
  if (names.empty())
    for (const View& view : views) names.push_back(view.name);
  run.drawings = draw_run(*device, *run.model, run.record.settings, views);
  const bool truth =
      std::any_of(views.begin(), views.end(), [](const View& view) { return view.has_image(); });
  run.views_from = fmt::format("{} of the {} views of split '{}' of {}{}{}", views.size(),
                               found->split.views.size(), found->split.name, found->data,
                               has_worst ? fmt::format(", the worst ('{}') among them", worst) : "",
                               truth ? "" : "; they have no images, so there is no ground truth");
}

// Makes the interactive viewer of a model that lists its cameras.
ReportViewer live_viewer(const ReportRun& run, const LoadedModel& loaded,
                         const std::shared_ptr<Device>& device) {
  const std::vector<Camera> cameras = noted_cameras(*run.model, loaded.notes.cameras);
  if (cameras.empty()) return {};
  const web::PackedForWeb packed =
      web::pack_for_web(device, *run.model, loaded.comments, cameras, run.record.settings);
  web::ViewerPage page{.title = run.record.name,
                       .scene = scene_frame(*run.model, cameras),
                       .start = start_camera(*run.model, cameras),
                       .captured = true};
  for (std::size_t i = 0; i < cameras.size(); ++i)
    page.cameras.push_back({.name = fmt::format("camera {}", i), .camera = cameras[i]});
  page.poster =
      web::poster_uri(web::draw_poster(device, *run.model, run.record.settings, cameras[page.start]));
  return {.markup = web::viewer_markup(page, run.record.settings, packed.bytes, true),
          .style = web::viewer_style(),
          .script = web::viewer_script(),
          .policy = web::kViewerPolicy,
          .psnr = packed.psnr.mean};
}

// If the model cannot be packed, returns no viewer and adds a remark; the rest of the page is still useful.
ReportViewer viewer_if_packed(ReportRun& run, const LoadedModel& loaded,
                              const std::shared_ptr<Device>& device) {
  try {
    return live_viewer(run, loaded, device);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::usage && error.kind() != ErrorKind::memory) throw;
    run.record.remarks.push_back(fmt::format(
        "the page has no interactive model, because: {}. The options of 'ubs web' can create a page with one",
        error.what()));
    return {};
  }
}

// Opens all runs. Sets `viewer` to the viewer of the first run whose model can be shown in a viewer.
std::vector<ReportRun> open_runs(ReportOptions& options, ReportViewer& viewer) {
  std::vector<ReportRun> runs;
  std::shared_ptr<Device> device;
  std::vector<std::string> names;  // names of the shown views, which the first run with views determines
  for (const std::string& folder : options.runs) {
    ReportRun run;
    run.record = read_run(folder, options.allow_outside);
    RunModel model = open_run_model(run.record);
    run.model = model.model;
    if (run.model && run.model->count() > 0) remark_on_splats(run.record, *run.model);
    if (run.model && run.model->count() > 0) {
      draw(run, model, options, device, names);
      if (viewer.markup.empty() && !options.no_viewer) {
        viewer = viewer_if_packed(run, model.loaded, device);
        viewer.run = runs.size();
      }
    }
    if (!options.json) {
      say("run      {}: {}{}\n", folder, run.model ? to_string(*run.model) : "no model",
          run.views_from.empty() ? "" : "; " + run.views_from);
      flush_out();
    }
    for (const std::string& remark : run.record.remarks) warn("{}: {}", folder, remark);
    runs.push_back(std::move(run));
  }
  return runs;
}

// Distinguishes runs with equal folder names by their paths.
void make_names_unique(std::vector<ReportRun>& runs, const std::vector<std::string>& paths) {
  for (std::size_t a = 0; a < runs.size(); ++a)
    for (std::size_t b = 0; b < runs.size(); ++b)
      if (a != b && fs::path(paths[a]) != paths[b] && runs[a].record.name == runs[b].record.name) {
        runs[a].record.name = paths[a], runs[b].record.name = paths[b];
      }
}

int run(ReportOptions& options) {
  files_before_output();
  if (options.out.empty() && options.runs.size() > 1)
    fail(ErrorKind::usage, "--out is required for several runs (see 'ubs report --help')");
  const std::string out =
      options.out.empty() ? (fs::path(options.runs[0]) / "report.html").string() : options.out;
  if (is_folder(out)) fail(ErrorKind::usage, "--out {}: this is a folder: pass the name of a file", out);
  // If the folder of the run does not exist, open_runs() reports this.
  if (!options.out.empty() || is_folder(options.runs[0]))
    check_output_files({out}, {options.data}, options.overwrite);
  check_extension(out, "HTML", {".html", ".htm"});
  ReportViewer viewer;
  std::vector<ReportRun> runs = open_runs(options, viewer);
  make_names_unique(runs, options.runs);
  const ReportPage page = make_report(runs, version_line(), viewer);
  write_file_atomically(out, page.html);
  if (options.json) {
    Json json{{"out", out},
              {"bytes", page.html.size()},
              {"pictures", page.pictures},
              {"picture_bytes", page.picture_bytes}};
    json.update(page.record);
    print_json(json);
    return 0;
  }
  const auto mib = [](std::size_t bytes) { return static_cast<double>(bytes) / (1 << 20); };
  say("page     {}: {:.2f} MiB, of which {} images are {:.2f} MiB\n", out, mib(page.html.size()),
      page.pictures, mib(page.picture_bytes));
  return 0;
}

}  // namespace

Command add_report(CLI::App& root) {
  CLI::App* app =
      root.add_subcommand("report", "Write an HTML report about one training run, or several side by side");
  const auto options = std::make_shared<ReportOptions>();
  app->add_option("runs", options->runs, "output folders of 'ubs train'")->required()->type_name("RUN...");
  app->add_option("--out", options->out, "page to write [RUN/report.html of a single run]")
      ->type_name("FILE");
  app->add_option("--data", options->data,
                  "data folder or packed file, instead of the one recorded in the runs")
      ->type_name("DIR|FILE");
  app->add_option("--views", options->views,
                  "number of test views to show; if more than one, the worst of the run is included [3]")
      ->check(from_to(1, 1000))
      ->type_name("N");
  app->add_flag("--no-viewer", options->no_viewer, "omit the interactive model at the top of the page");
  app->add_flag("--allow-outside", options->allow_outside,
                "allow links, absolute paths and .. in the runs and their data to refer to files outside of "
                "their folders");
  add_device_option(*app, options->device);
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "print the numbers of the page as JSON");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
