// SPDX-License-Identifier: Apache-2.0
// ubs eval: measures the image quality of a model on the views of a split.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>

#include "host/base/file.hpp"
#include "host/base/stopwatch.hpp"
#include "host/pipeline/frame_rate.hpp"
#include "host/run/open_data.hpp"
#include "host/run/run_cameras.hpp"
#include "host/run/verified_device.hpp"
#include "host/train/evaluate.hpp"
#include "tools/commands.hpp"
#include "tools/common/job.hpp"
#include "tools/common/lpips_options.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/program_version.hpp"

namespace ubs::tools {
namespace {

constexpr int kFramesPerView = 3;

struct EvalOptions : ModelOptions {
  explicit EvalOptions(CLI::App& app) : ModelOptions(app, drawing_keys()), lpips(app) {}
  std::string out;
  Appearance appearance{};
  LpipsOptions lpips;
  int fps_views = 20;
  bool json = false, overwrite = false;
};

Json frames_json(const FrameRate& rate) {
  if (rate.views == 0) return nullptr;
  return {{"fps_wall", rate.wall_fps},
          {"fps_device", rate.device_fps ? Json(*rate.device_fps) : Json(nullptr)},
          {"views", rate.views},
          {"frames_per_view", rate.frames_per_view}};
}

std::string memory_text(std::uint64_t bytes) {
  return fmt::format("{:.1f} MiB", static_cast<double>(bytes) / (1 << 20));
}

int run(EvalOptions& options) {
  const RunData run = use_run_data(options.model, options.data, options.settings.resolve());
  const bool first = ranks().first();  // the first rank of a job writes
  if (first) {
    check_output_files({options.out}, {options.model, options.data}, options.overwrite);
    check_extension(options.out, "JSON", {".json"});
  }
  const LpipsRequest lpips = options.lpips.request();
  const LoadedModel loaded = options.load();
  const MixedModel& model = loaded.model;
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, run);
  const Split split =
      open_split_for(loaded.offset, options.data, options.split, settings, Images::load, run.opened);
  require_images(split);
  check::Use use = drawing_use(model, settings);
  use.parts.push_back(check::Part::loss);
  if (options.lpips.wanted()) use.parts.push_back(check::Part::networks);
  ModelSession session(verified_request(device_of_rank(options.device), use), model, split, settings, false);
  const std::uint64_t before = session.device().allocated_bytes();
  ImageMetrics more(session.device(), lpips);
  const std::uint64_t weights = session.device().allocated_bytes() - before;
  std::uint64_t lpips_bytes = 0;
  for (const View& view : split.views) {
    const PlanarSize size{view.camera.width, view.camera.height};
    more.check_size(size);
    lpips_bytes = std::max(lpips_bytes, more.lpips_bytes(size));
  }
  const FrameRate rate =
      measure_frame_rate(session.device(), session.renderer(), session.model().view(), session.settings(),
                         first ? options.fps_views : 0, kFramesPerView);
  const std::uint64_t render_bytes = session.device().peak_bytes() - weights;
  TargetImages targets(session.device(), kTargetBudgetBytes,
                       static_cast<std::size_t>(settings.image_cache_mb) << 20);
  targets.add(split);

  const Stopwatch watch;
  Metrics metrics = evaluate(session.device(), session.stages(), session.renderer(), session.model().view(),
                             session.settings(), split.views, targets, 0, &more, options.appearance, ranks());
  if (!first) return 0;
  metrics.wide_images =
      measure_wide_images(session.device(), session.stages(), session.renderer(), session.model().view(),
                          session.settings(), split.views, cameras_of(split), &more, options.appearance);
  add_mean(metrics);
  if (const std::string& from = settings.run_cameras; !from.empty() && split.name != "train")
    if (const std::vector<Camera> fitted = run_cameras(from, split, loaded.offset); !fitted.empty())
      measure_from(session.device(), session.stages(), session.renderer(), session.model().view(),
                   session.settings(), split.views, fitted, targets, 0, metrics);
  const double seconds = watch.seconds();

  Json json{{"version", version()},
            {"build", build_id()},
            {"model", options.model},
            {"data", options.data},
            {"split", options.split},
            {"dim", model.dim()},
            {"variant", to_string(model.variant())},
            {"alpha_min", settings.alpha_min},
            {"splats", model.count()},
            {"groups", groups_json(model)},
            {"seconds", seconds},
            {"device", device_json(session.device().info())}};
  const std::uintmax_t storage = std::filesystem::file_size(options.model);
  json["storage_bytes"] = storage;
  json["render_peak_device_bytes"] = render_bytes;
  if (options.lpips.wanted()) json["lpips_predicted_device_bytes"] = lpips_bytes;
  json["peak_device_bytes"] = session.device().peak_bytes();
  json["frames"] = frames_json(rate);
  json.update(metrics_json(metrics));
  if (!options.out.empty()) write_file_atomically(options.out, json_file_text(json));
  if (options.json) {
    print_json(json);
    return 0;
  }
  for (const ViewMetrics& view : metrics.views) say("{:<24} {}\n", view.name, metrics_text(view));
  for (const ViewMetrics& image : metrics.wide_images)
    say("{:<24} {} (whole wide image)\n", image.name, metrics_text(image));
  const std::string wide =
      metrics.wide_images.empty()
          ? ""
          : fmt::format(" (the mean uses {} wide images instead of their views)", metrics.wide_images.size());
  say("{} views of '{}'{}: {}; {}, {:.2f} s on {}\n", metrics.views.size(), options.split, wide,
      metrics_text(metrics.mean), to_string(model), seconds, describe(session.device().info()));
  if (rate.views > 0)
    say("frames   {:.1f} per second{}, median of {} views\n", rate.wall_fps,
        rate.device_fps ? fmt::format(" (device alone {:.1f})", *rate.device_fps) : "", rate.views);
  say("memory   model {}; device memory {} for rendering, {} in total\n", memory_text(storage),
      memory_text(render_bytes), memory_text(session.device().peak_bytes()));
  return 0;
}

}  // namespace

Command add_eval(CLI::App& root) {
  CLI::App* app = root.add_subcommand("eval", "Measure a model against the images of a split");
  const auto options = std::make_shared<EvalOptions>(*app);
  app->get_option("--data")->description(kRunDataHelp);
  app->add_option("--out", options->out, "write the measurements to this JSON file")->type_name("FILE");
  app->add_option("--fps-views", options->fps_views,
                  "number of views on which frames per second are measured; 0: none [20]")
      ->check(not_negative())
      ->type_name("N");
  app->add_option(
         "--appearance", options->appearance,
         "also measure with exposure and white balance fitted to each image: none, gain or affine [none]")
      ->transform(CLI::CheckedTransformer(std::map<std::string, Appearance>{
          {"none", Appearance::none}, {"gain", Appearance::gain}, {"affine", Appearance::affine}}))
      ->type_name("MODE");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
