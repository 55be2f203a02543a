// SPDX-License-Identifier: Apache-2.0
// ubs web: writes a page that shows a model. If the output file has the extension .ubsz, writes only the
// compressed model (docs/web.md).
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/image.hpp"
#include "host/look/web/page.hpp"
#include "host/look/web/steps.hpp"
#include "host/run/open_data.hpp"
#include "host/run/verified_device.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/page_views.hpp"
#include "tools/common/path_options.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

struct WebOptions : ModelOptions {
  explicit WebOptions(CLI::App& app) : ModelOptions(app, drawing_keys()) { split = "train"; }
  std::string out, poster, title;
  double psnr = web::kPsnr;
  std::optional<int> view;
  int levels = 1;
  bool exact = false, embed = false, json = false, quiet = false, overwrite = false;
};

// Returns the index of the view that the page starts with.
std::size_t start_of(const WebOptions& options, const LoadedModel& loaded, const Split& split) {
  if (!options.view) return are_captured(options, loaded) ? start_camera(loaded.model, cameras_of(split)) : 0;
  if (*options.view < 0 || static_cast<std::size_t>(*options.view) >= split.views.size())
    fail(ErrorKind::usage, "--view {}: choose a view from 0 to {}", *options.view, split.views.size() - 1);
  return static_cast<std::size_t>(*options.view);
}

// Returns the name of the model file without its extension. The model of a run is always called model.ply, so
// the name of its folder is used instead.
std::string title_of(const fs::path& model) {
  const fs::path folder = fs::absolute(model).lexically_normal().parent_path().filename();
  return (model.filename() == "model.ply" && !folder.empty() ? folder : model.stem()).string();
}

web::ViewerPage page_of(const WebOptions& options, const LoadedModel& loaded, const Split& split,
                        std::size_t first) {
  const std::vector<Camera> cameras = cameras_of(split);
  web::ViewerPage page{.title = options.title,
                       .scene = scene_frame(loaded.model, cameras, frame_hints(loaded)),
                       .captured = are_captured(options, loaded)};
  if (page.title.empty()) page.title = title_of(options.model);
  const std::size_t step = (split.views.size() + web::kMaxCameras - 1) / web::kMaxCameras;
  for (std::size_t i = 0; i < split.views.size(); ++i) {
    const bool start = i == first;
    if (start) page.start = page.cameras.size();
    if (start || i % step == 0)
      page.cameras.push_back({.name = split.views[i].name, .camera = split.views[i].camera});
  }
  page.embed = options.embed;
  return page;
}

// Renders the poster of the page and saves it if the user asked for its file. Opens a device if `device` is
// null, as for an exact page. If this machine cannot render, this is only an error with --poster. Without
// --poster, a remark is printed, and the page is black until its first frame.
std::string poster_of(const WebOptions& options, std::shared_ptr<Device> device, const MixedModel& model,
                      const TrainSettings& settings, const Camera& camera) {
  try {
    if (!device) device = open_verified_device(options.device, drawing_use(model, settings, false));
    const Image8 still = web::draw_poster(device, model, settings, camera);
    if (!options.poster.empty()) save_png(options.poster, still);
    return web::poster_uri(still);
  } catch (const Error& error) {
    const bool cannot_draw = error.kind() == ErrorKind::device || error.kind() == ErrorKind::build ||
                             error.kind() == ErrorKind::memory || error.kind() == ErrorKind::faulty;
    if (!options.poster.empty() || !cannot_draw) throw;
    if (!options.quiet) remark("ubs: the page shows no preview image while it loads: {}\n", error.what());
    return {};
  }
}

int run(WebOptions& options) {
  files_before_output();
  const bool container = small_extension(options.out) == ".ubsz";
  if (container && (options.embed || !options.poster.empty() || !options.title.empty()))
    fail(ErrorKind::usage, "--out {}: --embed, --poster and --title only apply to HTML pages", options.out);
  check_output_files({options.out, options.poster}, {options.model, options.data}, options.overwrite);
  check_extension(options.out, "HTML", {".html", ".htm", ".ubsz"});
  check_extension(options.poster, "PNG", {".png"});
  const LoadedModel loaded = options.load();
  if (loaded.model.count() == 0) fail(ErrorKind::data, "{}: no splats to show", options.model);
  RunData run;
  if (!options.data.empty()) run = use_run_data(options.model, options.data, options.settings.resolve());
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, run);
  if (!settings.background.harmonics.empty()) remark("ubs: the page shows the mean colour of the sky\n");
  const Split split = page_views(options, loaded, settings, run.opened, frame_hints(loaded));
  const std::size_t start = start_of(options, loaded, split);
  const auto note = [&](const std::string& text) {
    if (!options.quiet) remark("ubs: {} ...\n", text);
  };
  const std::vector<Camera> cameras = cameras_of(split);
  for (const SplatModel& group : loaded.model.groups) check_query(split, group.dim);
  std::shared_ptr<Device> device;
  if (!options.exact)
    device = open_verified_device(options.device, drawing_use(loaded.model, settings, true));
  const web::PackedForWeb packed = options.exact
                                       ? web::PackedForWeb{pack_ubsz(loaded.model, loaded.comments), {}, {}}
                                       : web::pack_for_web(device, loaded.model, loaded.comments, cameras,
                                                           settings, options.psnr, options.levels, note);
  const std::vector<std::byte>& model = packed.bytes;
  Json json{
      {"out", options.out},
      {"splats", loaded.model.count()},
      {"model_bytes", model.size()},
      {"bytes_per_splat", static_cast<double>(model.size()) / static_cast<double>(loaded.model.count())},
      {"views", split.views.size()},
      {"exact", options.exact}};
  if (!options.exact) {
    json["psnr"] = packed.psnr.mean;
    json["psnr_worst"] = packed.psnr.worst;
  }
  for (const web::PackedForWeb::Level& level : packed.levels)
    json["levels"].push_back({{"bytes", level.bytes}, {"splats", level.splats}, {"psnr", level.psnr.mean}});
  if (container) {
    write_file_atomically(options.out, model);
  } else {
    web::ViewerPage page = page_of(options, loaded, split, start);
    for (const web::PackedForWeb::Level& level : packed.levels) page.parts.push_back(level.bytes);
    page.poster = poster_of(options, device, loaded.model, settings, cameras[start]);
    write_file_atomically(options.out, web::web_page(page, settings, model));
  }
  json["bytes"] = fs::file_size(options.out);
  if (options.json) {
    print_json(json);
    return 0;
  }
  say("model    {} in {:.2f} MB, {:.1f} bytes per splat\n", to_string(loaded.model),
      static_cast<double>(model.size()) / 1e6, json["bytes_per_splat"].get<double>());
  for (std::size_t k = 0; k < packed.levels.size(); ++k)
    say("level {}  {} splats in the first {:.2f} MB, PSNR {:.2f} dB\n", k + 1, packed.levels[k].splats,
        static_cast<double>(packed.levels[k].bytes) / 1e6, packed.levels[k].psnr.mean);
  if (options.exact)
    say("quality  lossless\n");
  else
    say("quality  PSNR {:.2f} dB against the original model (mean of {} cameras; lowest {:.2f} dB)\n",
        json["psnr"].get<double>(), split.views.size(), json["psnr_worst"].get<double>());
  say("{}     {}: {:.2f} MB\n", container ? "file" : "page", options.out,
      static_cast<double>(json["bytes"].get<std::size_t>()) / 1e6);
  return 0;
}

}  // namespace

Command add_web(CLI::App& root) {
  CLI::App* app = root.add_subcommand("web", "Write an HTML page that shows a model in any browser");
  const auto options = std::make_shared<WebOptions>(*app);
  app->get_option("--data")->required(false);
  app->get_option("--split")->description(
      "split whose cameras the page offers, and on which quality is measured [train]");
  app->add_option("--out", options->out,
                  "HTML page to write, or a file with the extension .ubsz for the compressed model alone")
      ->required()
      ->type_name("FILE");
  app->add_option("--psnr", options->psnr,
                  "quality of the compressed model: minimum PSNR against the original, averaged over the "
                  "cameras, in dB [50]")
      ->check(from_to(20.0, 80.0))
      ->type_name("DB");
  app->add_flag("--exact", options->exact, "store the parameters exactly, without quantisation")
      ->excludes("--psnr");
  app->add_option("--levels", options->levels,
                  "number of levels of detail, most important splats first; a page shows the first level "
                  "when 300 KB have arrived [1]")
      ->check(from_to(1, 8))
      ->excludes("--exact")
      ->type_name("K");
  app->add_option("--view", options->view,
                  "index of the camera that the page starts with [the first that shows the whole subject]")
      ->type_name("K");
  app->add_option("--poster", options->poster,
                  "also save the still image that the page shows until its first frame")
      ->type_name("FILE.png");
  app->add_flag("--embed", options->embed,
                "for embedding in another page: controls are folded, and the mouse wheel scrolls the outer "
                "page until a click");
  app->add_option("--title", options->title, "title of the page [name of the run folder or model file]")
      ->type_name("TEXT");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "machine-readable output");
  app->add_flag("--quiet", options->quiet, "do not print progress");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
