// SPDX-License-Identifier: Apache-2.0
// See run_drawings.hpp.
#include "host/look/report/run_drawings.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/image.hpp"
#include "host/model/scene_frame.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/train/run_settings.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

constexpr int kTimes = 6;
const struct {
  const char* name;
  BetaRange range;
} kParts[] = {{"lower half", {0, 0.5}}, {"upper half", {0.5, 1}}, {"top tenth", {0.9, 1}}};

KernelConfig painter_config(const Device& device, const MixedModel& model, const TrainSettings& settings) {
  KernelConfig config = kernel_config(model.dim(), model.variant(), settings, device.info());
  config.depth = true;
  config.backward = false;
  return config;
}

// ModelPainter renders the colour, alpha and depth of a model, or of a part of the model, from a set of
// cameras. It renders parts with the stages of the whole model, so that each kernel is compiled only once.
class ModelPainter {
 public:
  ModelPainter(Device& device, const MixedModel& model, const TrainSettings& settings)
      : device_(device),
        model_(device, model, painter_config(device, model, settings)),
        renderer_(device, model_.stages()),
        settings_(render_settings(settings)) {}

  void set_cameras(const std::vector<Camera>& cameras) { renderer_.set_cameras(cameras); }
  RenderedView draw(std::size_t camera) { return draw(camera, model_.view()); }

  // Renders a part of the model. The groups of `part` must have dimensions that the model has. The part may
  // be empty.
  RenderedView draw(std::size_t camera, const MixedModel& part) {
    std::vector<DeviceModel> models;
    std::vector<RenderGroup> groups;
    for (const SplatModel& group : part.groups) {
      const std::vector<DeviceModel>& whole = model_.groups();
      const auto like = std::find_if(whole.begin(), whole.end(),
                                     [&](const DeviceModel& m) { return m.dim() == group.dim; });
      if (like == whole.end()) fail(ErrorKind::internal, "the model has no group with N = {}", group.dim);
      models.emplace_back(device_, group);
      groups.push_back(
          {&model_.stages(static_cast<std::size_t>(like - whole.begin())), models.back().view()});
    }
    return draw(camera, groups);
  }

 private:
  RenderedView draw(std::size_t camera, std::span<const RenderGroup> groups) {
    renderer_.forward(groups, static_cast<std::uint32_t>(camera), settings_, false);
    return renderer_.download();
  }

  Device& device_;
  DeviceGroups model_;
  Renderer renderer_;
  RenderSettings settings_;
};

Image8 image_of(const RenderedView& view) {
  return image_from_interleaved(view.rgb, view.width, view.height);
}

DrawnView drawn_view(ModelPainter& painter, std::size_t camera, const View& view, bool timed) {
  RenderedView rendered = painter.draw(camera);
  DrawnView drawn{
      view.name, {}, image_of(rendered), {}, std::move(rendered.alpha), std::move(rendered.depth)};
  if (timed) drawn.time = view.camera.time;
  if (view.has_image()) drawn.truth = view.load_image();
  return drawn;
}

Decomposition decomposition(ModelPainter& painter, const MixedModel& model, BetaKind kind) {
  Decomposition out{kind, true, {}};
  const std::vector<float> values = beta_values(model, kind);
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  out.meaningful = low != values.end() && *low < *high;
  const std::vector<double> quantiles = beta_quantiles(model, kind);
  for (const auto& [name, range] : kParts) {
    const MixedModel part = keep_splats(model, select_by_quantile(quantiles, range));
    out.parts.push_back({name, range, part.count(), image_of(painter.draw(0, part))});
  }
  return out;
}

bool any_time(const MixedModel& model) {
  return std::any_of(model.groups.begin(), model.groups.end(),
                     [](const SplatModel& g) { return has_time(g.dim); });
}

// Returns the left or the right half of an image.
Image8 half(const Image8& both, bool right) {
  Image8 out{both.width / 2, both.height, {}};
  for (int y = 0; y < both.height; ++y) {
    const auto row = both.rgb.begin() + std::ptrdiff_t{3} * (y * both.width + (right ? out.width : 0));
    out.rgb.insert(out.rgb.end(), row, row + std::ptrdiff_t{3} * out.width);
  }
  return out;
}

}  // namespace

RunDrawings draw_run(Device& device, const MixedModel& model, const TrainSettings& settings,
                     const std::vector<View>& views) {
  const bool timed = any_time(model);
  std::vector<Camera> cameras;
  for (const View& view : views) cameras.push_back(view.camera);
  for (int k = 0; k < kTimes && timed; ++k) {
    cameras.push_back(views.front().camera);
    cameras.back().time = static_cast<double>(k) / (kTimes - 1);
  }
  ModelPainter painter(device, model, settings);
  painter.set_cameras(cameras);
  RunDrawings out;
  for (std::size_t i = 0; i < views.size(); ++i) out.views.push_back(drawn_view(painter, i, views[i], timed));
  out.apart_view = views.front().name;
  for (const BetaKind kind : kBetaKinds)
    if (has_beta(model, kind)) out.decompositions.push_back(decomposition(painter, model, kind));
  for (std::size_t i = views.size(); i < cameras.size(); ++i)
    out.times.push_back({cameras[i].time, image_of(painter.draw(i))});
  return out;
}

Camera circling_camera(const MixedModel& model, double azimuth, int width, int height) {
  constexpr double kDegree = std::numbers::pi / 180, kElevation = 25 * kDegree, kFov = 45 * kDegree;
  SceneFrame frame;
  if (model.count() > 0) frame = scene_frame(model, {}, {.elevation = kElevation, .fov = kFov});
  frame.start = std::cos(azimuth) * frame.start + std::sin(azimuth) * cross(frame.up, frame.start);
  Pose pose = orbit_start(frame);
  pose.fov = 2 * std::atan(std::tan(kFov / 2) * width / std::min(width, height));
  pose.time = 0.5;
  return camera_at(pose, {width, height, frame.extra});
}

std::vector<std::size_t> evenly_spaced(std::size_t size, std::size_t count) {
  std::vector<std::size_t> out;
  for (std::size_t k = 0; k < std::min(size, count); ++k) out.push_back(k * size / std::min(size, count));
  return out;
}

std::vector<DrawnView> saved_renders(const fs::path& folder, std::size_t count,
                                     std::vector<std::string>& remarks) {
  std::vector<fs::path> files;
  if (is_folder(folder))
    for (const fs::path& entry : folder_entries(folder))
      if (entry.extension() == ".png") files.push_back(entry);
  std::vector<DrawnView> views;
  for (const std::size_t i : evenly_spaced(files.size(), count)) {
    try {
      const Image8 both = load_image(files[i]);
      if (both.width % 2 != 0)
        fail(ErrorKind::data, "{}: this image does not consist of two images of the same size, side by side",
             files[i].string());
      views.push_back({files[i].stem().string(), {}, half(both, true), half(both, false), {}, {}});
    } catch (const Error& error) {
      remarks.push_back(error.what());
    }
  }
  return views;
}

}  // namespace ubs
