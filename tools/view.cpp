// SPDX-License-Identifier: Apache-2.0
// ubs view: a window to fly around in a model. The loop between viewer, renderer and window.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <numbers>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/base/stopwatch.hpp"
#include "host/data/image.hpp"
#include "host/data/resample.hpp"
#include "host/run/open_data.hpp"
#include "host/serve/live.hpp"
#include "host/view/keyframes.hpp"
#include "host/view/viewer.hpp"
#include "host/view/window.hpp"
#include "tools/commands.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/path_options.hpp"
#include "tools/common/serve_options.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

struct ViewOptions : ModelOptions {
  explicit ViewOptions(CLI::App& app) : ModelOptions(app, drawing_keys()), serve(app) { split = "train"; }
  ServeOptions serve;
  std::string size = "800x600", out = ".", keys, screenshot, up;
  double fov = 50, quit_after = -1;
  bool overwrite = false;
};

// The first of name.ext, name_1.ext, ... that does not exist.
fs::path free_name(const fs::path& folder, const std::string& name, const std::string& extension) {
  for (int i = 0;; ++i) {
    const fs::path path = folder / (i == 0 ? name + extension : fmt::format("{}_{}{}", name, i, extension));
    if (!path_exists(path)) return path;
  }
}

ViewerScene viewer_scene(const ViewOptions& options, const LoadedModel& loaded, const Split& views) {
  ViewerScene scene;
  scene.views = options.data.empty() ? noted_cameras(loaded.model, loaded.notes.cameras) : cameras_of(views);
  scene.fov = options.fov * std::numbers::pi / 180;
  FrameHints hints = frame_hints(loaded);
  hints.fov = 0.75 * scene.fov;  // pictures are less high than wide
  if (!options.up.empty()) hints.up = parse_vector("--up", options.up);
  scene.frame = scene_frame(loaded.model, scene.views, hints);
  scene.has_time =
      std::ranges::any_of(loaded.model.groups, [](const SplatModel& g) { return has_time(g.dim); });
  for (const BetaKind kind : kBetaKinds)
    scene.has_beta[static_cast<std::size_t>(kind)] = has_beta(loaded.model, kind);
  return scene;
}

// The model on a device; depth is compiled in when it is first asked for.
class Drawing {
 public:
  Drawing(const ViewOptions& options, const MixedModel& model, const TrainSettings& settings)
      : options_(options), model_(model), settings_(settings) {}

  // At `scale` of the viewer's size.
  Image8 draw(const Viewer& viewer, double scale) {
    const Camera camera = scaled(viewer.camera(), scale);
    prepare(viewer, camera);
    session_->renderer().set_cameras({camera});
    totals_ = session_->renderer().forward(session_->model().view(), 0, session_->settings(), false);
    const RenderedView view = session_->renderer().download();
    width_ = view.width;
    height_ = view.height;
    return picture(view, viewer.channel(),
                   viewer.channel() == Channel::depth ? depth_range(view) : DepthRange{});
  }

  std::string figures() const {
    return fmt::format("{} of {} splats drawn, {}x{}", totals_.visible, chosen_, width_, height_);
  }

 private:
  static Camera scaled(Camera camera, double scale) {
    const double width = std::max(8.0, std::round(camera.width * scale)),
                 height = std::max(8.0, std::round(camera.height * scale));
    camera.fx *= width / camera.width;
    camera.fy *= height / camera.height;
    camera.cx = width / 2;
    camera.cy = height / 2;
    camera.width = static_cast<int>(width);
    camera.height = static_cast<int>(height);
    return camera;
  }

  void prepare(const Viewer& viewer, const Camera& camera) {
    const bool depth = viewer.channel() == Channel::depth;
    if (!session_ || (depth && !depth_)) {
      Split split{.name = "view"};
      split.views.push_back({.name = "view", .camera = camera});
      session_.reset();
      session_ = std::make_unique<ModelSession>(options_.device, model_, split, settings_, depth);
      depth_ = depth;
      chosen_ = model_.count();
      choices_ = 1;
    }
    if (viewer.choices() != choices_) choose(viewer);
  }

  void choose(const Viewer& viewer) {
    std::vector<bool> keep(model_.count(), true);
    for (const BetaKind kind : kBetaKinds) {
      if (!viewer.scene().has_beta[static_cast<std::size_t>(kind)]) continue;
      std::vector<double>& quantiles = quantiles_[static_cast<std::size_t>(kind)];
      if (quantiles.empty()) quantiles = beta_quantiles(model_, kind);
      const std::vector<bool> of_kind = select_by_quantile(quantiles, viewer.beta(kind));
      for (std::size_t i = 0; i < keep.size(); ++i) keep[i] = keep[i] && of_kind[i];
    }
    const MixedModel part = keep_splats(model_, keep);
    session_->choose(part);
    chosen_ = part.count();
    choices_ = viewer.choices();
  }

  const ViewOptions& options_;
  const MixedModel& model_;
  TrainSettings settings_;
  std::unique_ptr<ModelSession> session_;
  bool depth_ = false;
  std::uint64_t choices_ = 0;
  std::array<std::vector<double>, 3> quantiles_;
  std::size_t chosen_ = 0;
  ListTotals totals_;
  int width_ = 0, height_ = 0;
};

// Side by side in a picture of the size of the second, which is the one that the window has.
Image8 beside(const Image8& left, const Image8& right) {
  Image8 both{right.width, right.height, std::vector<std::uint8_t>(right.rgb.size(), 0), {}};
  const int half = right.width / 2;
  int at = 0;
  for (const Image8* image : {&left, &right}) {
    const double scale = std::min(1.0 * half / image->width, 1.0 * right.height / image->height);
    const Image8 small = resize_bicubic(*image, std::max(1, static_cast<int>(image->width * scale)),
                                        std::max(1, static_cast<int>(image->height * scale)));
    const int top = (right.height - small.height) / 2;
    for (int y = 0; y < small.height; ++y)
      std::copy_n(small.rgb.begin() + std::ptrdiff_t{3} * y * small.width, 3 * small.width,
                  both.rgb.begin() + std::ptrdiff_t{3} * ((y + top) * both.width + at));
    at = half;
  }
  return both;
}

class Loop {
 public:
  Loop(const ViewOptions& options, const LoadedModel& loaded, const TrainSettings& settings,
       const Split& views, Viewer& viewer)
      : options_(options),
        loaded_(loaded),
        views_(views),
        viewer_(viewer),
        drawing_(options, loaded.model, settings) {}

  int run() {
    Window window(fmt::format("ubs view - {}", fs::path(options_.model).filename().string()), viewer_);
    for (const char key : options_.keys) viewer_.key(key);
    const InterruptGuard guard;
    Stopwatch watch;
    while (!viewer_.finished() && !guard.interrupted()) {
      viewer_.advance(watch.seconds());
      watch.restart();
      const bool drawn = update();
      orders();
      window.show(picture_, lines(),
                  viewer_.help() ? viewer_help(viewer_.scene()) : std::vector<std::string>{});
      window.poll(drawn ? 1 : 15);
      if (still() && finish()) break;
    }
    return guard.interrupted() ? kInterruptedExitCode : 0;
  }

 private:
  static constexpr double kRest =
      0.15;  // seconds without a change, after which the picture is drawn at full size

  bool still() const { return viewer_.changes() == drawn_changes_ && scale_ == 1; }

  // Small while something changes, in full when nothing does; whether anything was drawn.
  bool update() {
    const bool changed = viewer_.changes() != drawn_changes_, first = picture_.width == 0;
    if (!changed && (scale_ == 1 || changed_.seconds() < kRest)) return false;
    if (changed) changed_.restart();
    scale_ = changed && !first ? adaptive_.scale() : 1;
    const std::uint64_t changes = viewer_.changes();
    const Stopwatch watch;
    picture_ = drawing_.draw(viewer_, scale_);
    seconds_ = watch.seconds();
    show_truth();
    if (!first) adaptive_.measured(scale_, seconds_);  // the first one compiles kernels
    drawn_changes_ = changes;
    return true;
  }

  void show_truth() {
    if (viewer_.truth() < 0) return;
    const auto view = static_cast<std::size_t>(viewer_.truth());
    if (view >= views_.views.size() || !views_.views[view].has_image())
      note_ = "photographs are shown with --data DIR";
    else
      picture_ = beside(views_.views[view].load_image(), picture_);
  }

  std::vector<std::string> lines() const {
    if (!viewer_.overlay()) return {};
    std::string line = fmt::format("{:.1f} FPS  {}  {}", 1 / std::max(seconds_, 1e-6), drawing_.figures(),
                                   to_string(viewer_.channel()));
    if (viewer_.scene().has_time) line += fmt::format("  t = {:.3f}", viewer_.pose().time);
    if (!viewer_.keyframes().empty()) line += fmt::format("  {} keyframes", viewer_.keyframes().size());
    return {line, note_.empty() ? "H: help" : note_};
  }

  void orders() {
    for (const Order order : viewer_.take_orders()) {
      try {
        if (order == Order::save_picture) {
          const fs::path path = free_name(options_.out, "view", ".png");
          save_png(path, drawing_.draw(viewer_, 1));
          note_ = "saved " + path.string();
        } else {
          if (keyframe_file_.empty()) keyframe_file_ = free_name(options_.out, "keyframes", ".json");
          write_keyframes(keyframe_file_,
                          {.poses = viewer_.keyframes(), .has_time = viewer_.scene().has_time},
                          loaded_.offset);
          note_ = "saved " + keyframe_file_.string();
        }
      } catch (const Error& error) {  // a full disk must not end the flight
        note_ = error.what();
      }
      say("{}\n", note_);
    }
  }

  // For scripts: the picture saved, the window shown for a while, the end.
  bool finish() {
    if (!options_.screenshot.empty() && !saved_) save_png(options_.screenshot, picture_);
    if (!saved_) shown_.restart();
    saved_ = true;
    return options_.quit_after >= 0 && shown_.seconds() >= options_.quit_after;
  }

  const ViewOptions& options_;
  const LoadedModel& loaded_;
  const Split& views_;
  Viewer& viewer_;
  Drawing drawing_;
  AdaptiveScale adaptive_;
  Image8 picture_;
  double scale_ = 1, seconds_ = 0;
  std::uint64_t drawn_changes_ = 0;
  Stopwatch changed_, shown_;
  bool saved_ = false;
  std::string note_;
  fs::path keyframe_file_;
};

struct Opened {
  TrainSettings settings;
  Split views;  // of the data that are named
};

// Data are read as the run did that made the model of them.
Opened open_views(const ViewOptions& options, const LoadedModel& loaded) {
  std::string data = options.data;
  RunData run;
  if (!data.empty()) run = use_run_data(options.model, data);
  Opened opened{drawing_settings(options.settings, loaded, options.model, run), {}};
  if (data.empty()) return opened;
  TrainSettings reading = opened.settings;
  reading.image_cache_mb = 1;  // photographs are decoded when they are looked at
  opened.views = open_split_for(loaded.offset, data, options.split, reading, Images::load, run.opened);
  return opened;
}

// In a browser in the place of the window.
int serve_views(const ViewOptions& options, serve::Server& server) {
  const LoadedModel loaded = options.load();
  auto [settings, split] = open_views(options, loaded);
  const ViewerScene viewed = viewer_scene(options, loaded, split);
  serve::Scene scene{.title = fs::path(options.model).filename().string(),
                     .frame = viewed.frame,
                     .has_time = viewed.has_time};
  std::vector<Camera> cameras = evenly_chosen(viewed.views, serve::kMaxCameras);
  if (cameras.empty()) cameras = {Viewer(viewed, 800, 600).camera()};
  for (std::size_t i = 0; i < cameras.size(); ++i)
    scene.cameras.push_back({.name = fmt::format("camera {}", i), .camera = cameras[i]});
  split.views = scene.cameras;
  ModelSession session(options.device, loaded.model, split, settings, false);
  const InterruptGuard guard;
  serve::serve_model(server, session, loaded.model, scene, [&] { return guard.interrupted(); });
  return kInterruptedExitCode;
}

int run(const ViewOptions& options) {
  if (const auto server = options.serve.open()) return serve_views(options, *server);
  const ImageSize size = parse_size("--size", options.size);
  if (!is_folder(options.out)) fail(ErrorKind::usage, "--out {}: is no folder", options.out);
  check_output_files({options.screenshot}, {options.model, options.data}, options.overwrite);
  require_display();
  const LoadedModel loaded = options.load();
  const auto [settings, views] = open_views(options, loaded);
  Viewer viewer(viewer_scene(options, loaded, views), size.width, size.height);
  return Loop(options, loaded, settings, views, viewer).run();
}

}  // namespace

Command add_view(CLI::App& root) {
  CLI::App* app = root.add_subcommand(
      "view", "A window, or with --serve a page, to fly around in a model (H shows mouse and keys)");
  const auto options = std::make_shared<ViewOptions>(*app);
  app->get_option("--split")->description("train, val or test [train]");
  app->add_option("--size", options->size, "of the picture in the window [800x600]")->type_name("WxH");
  app->add_option("--fov", options->fov,
                  "horizontal angle of view in degrees, where no view of --data says another [50]")
      ->check(from_to(1.0, 170.0))
      ->type_name("NUMBER");
  app->add_option("--up", options->up, kUpHelp)->type_name("X,Y,Z");
  app->add_option("--out", options->out, "folder for view.png (key P) and keyframes.json (key K) [.]")
      ->type_name("DIR");
  app->add_option("--keys", options->keys, "keys that are pressed at the beginning, such as 2M")
      ->type_name("TEXT");
  app->add_option("--screenshot", options->screenshot, "saves the first finished picture, without text")
      ->type_name("FILE.png");
  app->add_option("--quit-after", options->quit_after,
                  "ends so many seconds after the first finished picture [never]")
      ->check(not_negative())
      ->type_name("NUMBER");
  for (const char* windowed : {"--size", "--out", "--keys", "--screenshot", "--quit-after"})
    options->serve.option().excludes(app->get_option(windowed));
  add_overwrite_option(*app, options->overwrite);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
