// SPDX-License-Identifier: Apache-2.0
// ubs gradients: the loss of one view and its gradient with respect to every raw parameter, written in
// the layout of the model file. Without regularisers; for checking us against another implementation.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/output_place.hpp"
#include "host/data/npy.hpp"
#include "host/data/ply.hpp"
#include "host/oracle/oracle.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "host/run/open_data.hpp"
#include "host/run/proved_device.hpp"
#include "host/scene/camera_motion.hpp"
#include "host/train/run_settings.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {
namespace {

std::vector<std::string_view> gradient_keys() {
  std::vector<std::string_view> keys = drawing_keys();
  keys.insert(keys.end(), {"lambda_dssim", "query_grad"});
  return keys;
}

struct GradientsOptions : ModelOptions {
  explicit GradientsOptions(CLI::App& app) : ModelOptions(app, gradient_keys()) {}
  std::string out, target;
  int view = 0;
  bool json = false, cameras = false;
};

// (3, H, W) from the .npy file of shape (H, W, 3), or from the view's image, which may bring a mask.
std::vector<float> planar_target(const GradientsOptions& options, const View& view,
                                 std::vector<std::uint8_t>& mask) {
  const std::size_t height = static_cast<std::size_t>(view.camera.height);
  const std::size_t width = static_cast<std::size_t>(view.camera.width);
  std::vector<float> interleaved;
  if (!options.target.empty()) {
    NpyArray array = read_npy(options.target);
    if (array.shape != std::vector<std::size_t>{height, width, 3})
      fail(ErrorKind::data, "{}: the shape is ({}), view '{}' needs ({}, {}, 3)", options.target,
           fmt::join(array.shape, ", "), view.name, height, width);
    interleaved = std::move(array.values);
    if (!std::ranges::all_of(interleaved, [](float v) { return std::isfinite(v); }))
      fail(ErrorKind::data, "{}: holds values that are not finite", options.target);
  } else {
    if (!view.has_image())
      fail(ErrorKind::data, "view '{}' has no image file: give the target with --target T.npy", view.name);
    const Image8 image = view.load_image();
    mask = image.mask;
    for (const std::uint8_t v : image.rgb) interleaved.push_back(static_cast<float>(v) / 255.0f);
  }
  std::vector<float> planar(interleaved.size());
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < width * height; ++i) planar[c * width * height + i] = interleaved[3 * i + c];
  return planar;
}

// By parameter group, over the splats of all dimensions.
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

// Names and conventions of ubs_camera_gradient (include/ubs/ubs.h).
Json camera_json(const CameraGradient& gradient, const Camera& camera) {
  std::array<double, 6> pose{};
  std::ranges::copy(gradient.turn, pose.begin());
  std::ranges::copy(gradient.shift, pose.begin() + 3);
  return {{"pose", pose},          {"world_to_camera", matrix_gradient(gradient, camera)},
          {"fx", gradient.fx},     {"fy", gradient.fy},
          {"cx", gradient.cx},     {"cy", gradient.cy},
          {"time", gradient.time}, {"extra", gradient.extra}};
}

// The oracle looks at every splat at every pixel, and for the differences 20 times.
constexpr double kMostOracleWork = 3e8;

// Of one number of the camera, in the order of kCameraWords: ours, the oracle's derivative, and central
// differences of the oracle's loss.
struct CameraRow {
  double found = 0, derivative = 0, difference = 0;
};
constexpr std::array kCameraWords{"turn x",  "turn y", "turn z", "shift x", "shift y",
                                  "shift z", "fx",     "fy",     "cx",      "cy"};

Camera camera_changed(const Camera& camera, std::size_t number, double by) {
  Camera out = camera;
  CameraMove move{};
  if (number < 3) {
    move[number] = by;
    return moved(camera, move, 0);
  }
  (number < 6   ? out.translation[number - 3]
   : number < 7 ? out.fx
   : number < 8 ? out.fy
   : number < 9 ? out.cx
                : out.cy) += by;
  return out;
}

std::vector<CameraRow> compare_camera(const CameraGradient& found, const SplatModel& model,
                                      const Camera& camera, std::span<const float> target,
                                      const TrainSettings& settings) {
  const oracle::Model exact = oracle::to_model(model);
  const oracle::Options options{.near_plane = settings.near_plane,
                                .far_plane = settings.far_plane,
                                .eps2d = settings.eps2d,
                                .background = settings.background.colour,
                                .lambda_dssim = settings.lambda_dssim,
                                .query_grad = settings.query_grad,
                                .alpha_min = settings.alpha_min,
                                .variant = model.variant};
  const std::vector<double> truth(target.begin(), target.end());
  const std::vector<double> image = oracle::render(exact, camera, options).image;
  std::vector<double> weights = oracle::ssim_gradient(image, truth, 3, camera.height, camera.width);
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double sign = image[i] > truth[i] ? 1 : image[i] < truth[i] ? -1 : 0;
    weights[i] = (1 - settings.lambda_dssim) * sign / static_cast<double>(weights.size()) -
                 settings.lambda_dssim * weights[i];
  }
  const auto derivative = oracle::view_gradients(exact, camera, weights, {}, options).camera;
  const std::array<double, 10> ours{found.turn[0],  found.turn[1],  found.turn[2], found.shift[0],
                                    found.shift[1], found.shift[2], found.fx,      found.fy,
                                    found.cx,       found.cy};
  std::vector<CameraRow> rows;
  for (std::size_t k = 0; k < ours.size(); ++k) {
    const double h = k < 6 ? 1e-6 : 1e-4;
    const auto at = [&](double step) {
      return oracle::loss(exact, camera_changed(camera, k, step), truth, options);
    };
    rows.push_back({ours[k], derivative[k], (at(h) - at(-h)) / (2 * h)});
  }
  return rows;
}

void print_camera(std::span<const CameraRow> rows) {
  say("  {:<8} {:>15} {:>15} {:>15} {:>10}\n", "camera", "float32", "float64", "differences", "error");
  double largest = 1e-30;
  for (const CameraRow& row : rows) largest = std::max(largest, std::abs(row.derivative));
  for (std::size_t k = 0; k < rows.size(); ++k)
    say("  {:<8} {:>15.7e} {:>15.7e} {:>15.7e} {:>10.2e}\n", kCameraWords[k], rows[k].found,
        rows[k].derivative, rows[k].difference, std::abs(rows[k].found - rows[k].derivative) / largest);
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
  const std::optional<TrainSettings> trained = use_run_data(options.model, options.data);
  check_output_files({options.out}, {options.model, options.target, options.data});
  const LoadedModel loaded = options.load();
  const MixedModel& model = loaded.model;
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, trained);
  const Split split = open_split_for(loaded.offset, options.data, options.split, settings,
                                     options.target.empty() ? Images::load : Images::skip);
  if (options.view < 0 || static_cast<std::size_t>(options.view) >= split.views.size())
    fail(ErrorKind::usage, "--view {}: split '{}' has the views 0 to {}", options.view, split.name,
         split.views.size() - 1);
  const View& view = split.views[static_cast<std::size_t>(options.view)];
  for (const SplatModel& group : model.groups) check_query(split, group.dim);
  std::vector<std::uint8_t> mask;
  const std::vector<float> target = planar_target(options, view, mask);
  const std::unique_ptr<Device> device =
      open_proved_device(options.device, drawing_use(model, settings, true));
  const MixedViewGradient gradient = view_gradient(
      *device, config_for(*device, model, settings, false, true), model, view.camera, target,
      render_settings(settings), static_cast<float>(settings.lambda_dssim), mask, options.cameras);
  if (!std::isfinite(gradient.loss))
    fail(ErrorKind::numerical, "the loss of view '{}' is not finite", view.name);
  for (const SplatModel& group : gradient.values.groups) check_finite(group, view);
  Json camera = camera_json(gradient.camera, view.camera);
  for (const Json& number : camera.flatten())
    if (!std::isfinite(number.get<double>()))
      fail(ErrorKind::numerical, "the gradient of the camera of view '{}' is not finite", view.name);
  write_mixed_ply(options.out, gradient.values);

  const Json norms = parameter_norms(gradient.values);
  std::vector<CameraRow> rows;
  std::string why_none;
  if (options.cameras) {
    const double work = static_cast<double>(model.count()) * view.camera.width * view.camera.height;
    if (model.groups.size() > 1 || !mask.empty())
      why_none = "the float64 reference takes splats of one dimension and images without masks";
    else if (work > kMostOracleWork)
      why_none =
          fmt::format("{} splats at {}x{} pixels would take the float64 reference minutes; --downscale",
                      model.count(), view.camera.width, view.camera.height);
    else
      rows = compare_camera(gradient.camera, model.groups[0], view.camera, target, settings);
    for (std::size_t k = 0; k < rows.size(); ++k)
      camera["float64"].push_back({{"name", kCameraWords[k]},
                                   {"found", rows[k].found},
                                   {"derivative", rows[k].derivative},
                                   {"difference", rows[k].difference}});
  }
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
  if (!rows.empty()) print_camera(rows);
  if (!why_none.empty()) say("  no comparison of the camera's gradient: {}\n", why_none);
  camera.erase("float64");
  for (const auto& [name, values] : camera.items())
    if (options.cameras) say("  d loss / d camera {} = {}\n", name, values.dump());
  say("gradients of {} splats in {}\n", model.count(), options.out);
  return 0;
}

}  // namespace

Command add_gradients(CLI::App& root) {
  CLI::App* app = root.add_subcommand(
      "gradients", "Write the gradient of one view's loss with respect to every parameter");
  const auto options = std::make_shared<GradientsOptions>(*app);
  app->get_option("--data")->description(kRunDataHelp);
  app->add_option("--view", options->view, "number of the view in the split")->required()->type_name("K");
  app->add_option("--target", options->target, "float32 (H,W,3) image to compare with [the view's image]")
      ->type_name("T.npy");
  app->add_option("--out", options->out, "gradients in the layout of the model file")
      ->required()
      ->type_name("G.ply");
  app->add_flag("--cameras", options->cameras,
                "also the gradient with respect to the camera: pose, matrix, focal lengths, principal point, "
                "queries; and its errors against float64");
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
