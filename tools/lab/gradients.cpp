// SPDX-License-Identifier: Apache-2.0
// ubs-lab gradients: computes the loss of one view and its gradient with respect to every raw parameter, and
// writes the gradient in the layout of the model file. The loss has no regularisers. With this command, ubs
// can be compared with other implementations.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>

#include "host/base/error.hpp"
#include "host/dataset/npy.hpp"
#include "host/formats/ply.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "host/run/open_data.hpp"
#include "host/run/verified_device.hpp"
#include "host/train/run_settings.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/lab/lab_commands.hpp"

namespace ubs::tools {
namespace {

struct GradientsOptions : ModelOptions {
  explicit GradientsOptions(CLI::App& app)
      : ModelOptions(app, drawing_keys({"lambda_dssim", "query_grad"})) {}
  std::string out, target;
  int view = 0;
  bool json = false, cameras = false, overwrite = false;
};

// Returns the target as (3, H, W). It is read from the .npy file of shape (H, W, 3), or from the view's
// image, which may have a mask.
std::vector<float> planar_target(const GradientsOptions& options, const View& view,
                                 std::vector<std::uint8_t>& mask) {
  const std::size_t height = static_cast<std::size_t>(view.camera.height);
  const std::size_t width = static_cast<std::size_t>(view.camera.width);
  std::vector<float> interleaved;
  if (!options.target.empty()) {
    NpyArray array = read_npy(options.target);
    if (array.shape != std::vector<std::size_t>{height, width, 3})
      fail(ErrorKind::data, "{}: the shape is ({}), but view '{}' needs ({}, {}, 3)", options.target,
           fmt::join(array.shape, ", "), view.name, height, width);
    interleaved = std::move(array.values);
    if (!std::ranges::all_of(interleaved, [](float v) { return std::isfinite(v); }))
      fail(ErrorKind::data, "{}: contains values that are not finite", options.target);
  } else {
    if (!view.has_image())
      fail(ErrorKind::data, "view '{}' has no image file: pass the target with --target T.npy", view.name);
    const Image8 image = view.load_image();
    mask = image.mask;
    for (const std::uint8_t v : image.rgb) interleaved.push_back(static_cast<float>(v) / 255.0f);
  }
  return planar(interleaved);
}

// Returns the norm of the gradient of each parameter group, over the splats of all dimensions.
Json parameter_norms(const MixedModel& gradient) {
  Json squares = Json::object();
  for (const SplatModel& splats : gradient.groups)
    for (const ParameterGroup& g : parameter_groups(splats.layout())) {
      double sum = squares.value(g.name, 0.0);
      for (int r = g.first; r < g.first + g.count; ++r)
        for (const float v : splats.row(r)) sum += static_cast<double>(v) * v;
      squares[g.name] = sum;
    }
  for (auto& [name, square] : squares.items()) square = std::sqrt(square.get<double>());
  return squares;
}

// Returns the gradient with respect to the camera. Names and conventions are those of ubs_camera_gradient
// (include/ubs/ubs.h).
Json camera_json(const CameraGradient& gradient, const Camera& camera) {
  std::array<double, 6> pose{};
  std::ranges::copy(gradient.turn, pose.begin());
  std::ranges::copy(gradient.shift, pose.begin() + 3);
  return {{"pose", pose},          {"world_to_camera", matrix_gradient(gradient, camera)},
          {"fx", gradient.fx},     {"fy", gradient.fy},
          {"cx", gradient.cx},     {"cy", gradient.cy},
          {"time", gradient.time}, {"extra", gradient.extra}};
}

void check_finite(const SplatModel& gradient, const View& view) {
  const auto bad = std::ranges::find_if(gradient.values, [](float v) { return !std::isfinite(v); });
  if (bad == gradient.values.end()) return;
  const auto at = static_cast<std::size_t>(bad - gradient.values.begin());
  fail(ErrorKind::numerical, "view '{}': the gradient of splat {} with respect to {} is not finite ({})",
       view.name, at % gradient.count, gradient.layout().property_names()[at / gradient.count], *bad);
}

int run(GradientsOptions& options) {
  files_before_output();
  const RunData run = use_run_data(options.model, options.data, options.settings.resolve());
  check_output_files({options.out}, {options.model, options.target, options.data}, options.overwrite);
  const LoadedModel loaded = options.load();
  const MixedModel& model = loaded.model;
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, run);
  const Split split = open_split_for(loaded.offset, options.data, options.split, settings,
                                     options.target.empty() ? Images::load : Images::skip, run.opened);
  if (options.view < 0 || static_cast<std::size_t>(options.view) >= split.views.size())
    fail(ErrorKind::usage, "--view {}: split '{}' has the views 0 to {}", options.view, split.name,
         split.views.size() - 1);
  const View& view = split.views[static_cast<std::size_t>(options.view)];
  for (const SplatModel& group : model.groups) check_query(split, group.dim);
  std::vector<std::uint8_t> mask;
  const std::vector<float> target = planar_target(options, view, mask);
  const std::unique_ptr<Device> device =
      open_verified_device(options.device, drawing_use(model, settings, true));
  const MixedViewGradient gradient = view_gradient(
      *device, config_for(*device, model, settings, false, true), model, view.camera, target,
      render_settings(settings), static_cast<float>(settings.lambda_dssim), mask, options.cameras);
  if (!std::isfinite(gradient.loss))
    fail(ErrorKind::numerical, "the loss of view '{}' is not finite", view.name);
  for (const SplatModel& group : gradient.values.groups) check_finite(group, view);
  const Json camera = camera_json(gradient.camera, view.camera);
  for (const Json& number : camera.flatten())
    if (!std::isfinite(number.get<double>()))
      fail(ErrorKind::numerical, "the gradient of the camera of view '{}' is not finite", view.name);
  write_mixed_ply(options.out, gradient.values);

  const Json norms = parameter_norms(gradient.values);
  if (options.json) {
    Json answer{{"loss", gradient.loss},
                {"l1", gradient.l1},
                {"ssim", gradient.ssim},
                {"lambda_dssim", settings.lambda_dssim},
                {"query_grad", settings.query_grad},
                {"alpha_min", settings.alpha_min},
                {"view", view.name},
                {"dim", model.dim()},
                {"variant", to_string(model.variant())},
                {"splats", model.count()},
                {"groups", groups_json(model)},
                {"gradient_norms", norms},
                {"device", device_json(device->info())},
                {"out", options.out}};
    if (options.cameras) answer["camera_gradient"] = camera;
    print_json(answer);
    return 0;
  }
  say("view {}: loss {:.9g} (L1 {:.9g}, SSIM {:.9g})\n", view.name, gradient.loss, gradient.l1,
      gradient.ssim);
  for (const auto& [name, norm] : norms.items())
    say("  |d loss / d {}| = {:.6g}\n", name, norm.get<double>());
  if (options.cameras)
    for (const auto& [name, values] : camera.items())
      say("  d loss / d camera {} = {}\n", name, values.dump());
  say("gradients of {} splats in {}\n", model.count(), options.out);
  return 0;
}

}  // namespace

Command add_gradients(CLI::App& root) {
  CLI::App* app = root.add_subcommand(
      "gradients", "Write the gradient of one view's loss with respect to every parameter");
  const auto options = std::make_shared<GradientsOptions>(*app);
  app->get_option("--data")->description(kRunDataHelp);
  app->add_option("--view", options->view, "index of the view in the split")->required()->type_name("K");
  app->add_option("--target", options->target, "float32 (H,W,3) image to compare with [the view's image]")
      ->type_name("T.npy");
  app->add_option("--out", options->out, "file to write the gradients to, in the layout of the model file")
      ->required()
      ->type_name("G.ply");
  app->add_flag("--cameras", options->cameras,
                "also compute the gradient with respect to the camera: pose, matrix, focal lengths, "
                "principal point, queries");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
