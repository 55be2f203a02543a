// SPDX-License-Identifier: Apache-2.0
// See model_painter.hpp.
#include "host/report/model_painter.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/train/run_settings.hpp"
#include "host/view/scene_frame.hpp"

namespace ubs {
namespace {

KernelConfig painter_config(const Device& device, const MixedModel& model, const TrainSettings& settings) {
  KernelConfig config = kernel_config(model.dim(), model.variant(), settings, device.info());
  config.depth = true;
  config.backward = false;
  return config;
}

}  // namespace

ModelPainter::ModelPainter(Device& device, const MixedModel& model, const TrainSettings& settings)
    : device_(device),
      model_(device, model, painter_config(device, model, settings)),
      renderer_(device, model_.stages()),
      settings_(render_settings(settings)) {}

RenderedView ModelPainter::draw(std::size_t camera, std::span<const RenderGroup> groups) {
  renderer_.forward(groups, static_cast<std::uint32_t>(camera), settings_, false);
  return renderer_.download();
}

RenderedView ModelPainter::draw(std::size_t camera) { return draw(camera, model_.view()); }

RenderedView ModelPainter::draw(std::size_t camera, const MixedModel& part) {
  std::vector<DeviceModel> models;
  std::vector<RenderGroup> groups;
  for (const SplatModel& group : part.groups) {
    const std::vector<DeviceModel>& whole = model_.groups();
    const auto like =
        std::find_if(whole.begin(), whole.end(), [&](const DeviceModel& m) { return m.dim() == group.dim; });
    if (like == whole.end()) fail(ErrorKind::internal, "a part of N = {} of a model without it", group.dim);
    models.emplace_back(device_, group);
    groups.push_back({&model_.stages(static_cast<std::size_t>(like - whole.begin())), models.back().view()});
  }
  return draw(camera, groups);
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

}  // namespace ubs
