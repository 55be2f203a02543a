// SPDX-License-Identifier: Apache-2.0
// See model_painter.hpp.
#include "host/report/model_painter.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/train/run_settings.hpp"

namespace ubs {
namespace {

using Vec3 = std::array<double, 3>;

KernelConfig painter_config(const Device& device, const MixedModel& model, const TrainSettings& settings) {
  KernelConfig config = kernel_config(model.dim(), model.variant(), settings, device.info());
  config.depth = true;
  config.backward = false;
  return config;
}

double quantile(std::vector<double> values, double q) {
  const auto at = values.begin() + std::lround(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vec3 unit(Vec3 v) {
  const double length = std::sqrt(dot(v, v));
  for (double& x : v) x /= length;
  return v;
}

std::vector<Vec3> means_of(const MixedModel& model) {
  std::vector<Vec3> means;
  for (const SplatModel& group : model.groups)
    for (std::size_t i = 0; i < group.count; ++i)
      means.push_back({group.row(0)[i], group.row(1)[i], group.row(2)[i]});
  return means;
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
  constexpr double kElevation = 25 * std::numbers::pi / 180, kTanHalfView = 0.41421356237309503;
  constexpr double kRadii = 2.6;  // 90 % of the means fill most of the image
  const std::vector<Vec3> means = means_of(model);
  Vec3 centre{};
  double radius = 1;
  if (!means.empty()) {
    for (std::size_t a = 0; a < 3; ++a) {
      std::vector<double> values;
      for (const Vec3& m : means) values.push_back(m[a]);
      centre[a] = quantile(std::move(values), 0.5);
    }
    std::vector<double> distances;
    for (const Vec3& m : means)
      distances.push_back(std::hypot(m[0] - centre[0], m[1] - centre[1], m[2] - centre[2]));
    radius = std::max(1e-6, quantile(std::move(distances), 0.9));
  }
  const Vec3 away{std::cos(kElevation) * std::cos(azimuth), std::cos(kElevation) * std::sin(azimuth),
                  std::sin(kElevation)};
  const Vec3 forward{-away[0], -away[1], -away[2]};
  const Vec3 right = unit(cross(forward, {0, 0, 1})), down = cross(forward, right);
  Camera camera;
  camera.width = width, camera.height = height;
  camera.fx = camera.fy = 0.5 * std::min(width, height) / kTanHalfView;
  camera.cx = 0.5 * width, camera.cy = 0.5 * height;
  const Vec3 axes[] = {right, down, forward};
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) camera.rotation[3 * r + c] = axes[r][c];
    const Vec3 eye{centre[0] + kRadii * radius * away[0], centre[1] + kRadii * radius * away[1],
                   centre[2] + kRadii * radius * away[2]};
    camera.translation[r] = -dot(axes[r], eye);
  }
  camera.time = 0.5;
  camera.extra.assign(static_cast<std::size_t>(std::max(0, model.dim() - 7)), 0.5);
  return camera;
}

}  // namespace ubs
