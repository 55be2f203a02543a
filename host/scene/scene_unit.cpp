// SPDX-License-Identifier: Apache-2.0
#include "host/scene/scene_unit.hpp"

#include <algorithm>
#include <memory>
#include <utility>

#include "host/scene/spatial_factor.hpp"

namespace ubs {
namespace {

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

std::vector<double> depths_seen(const Camera& c, const PointCloud& points, std::size_t step) {
  const auto& r = c.rotation;
  std::vector<double> depths;
  for (std::size_t i = 0; i < points.positions.size(); i += step) {
    const auto& p = points.positions[i];
    std::array<double, 3> at = c.translation;
    for (std::size_t row = 0; row < 3; ++row)
      for (std::size_t k = 0; k < 3; ++k) at[row] += r[3 * row + k] * p[k];
    const double column = c.fx * at[0] / at[2] + c.cx, line = c.fy * at[1] / at[2] + c.cy;
    if (at[2] > 0 && column > 0 && line > 0 && column < c.width && line < c.height) depths.push_back(at[2]);
  }
  return depths;
}

// An image that another view holds in memory.
class HeldImage : public ImageSource {
 public:
  explicit HeldImage(const Image8& image) : image_(image) {}
  Image8 load() const override { return image_; }
  const Image8* held() const override { return &image_; }

 private:
  const Image8& image_;
};

}  // namespace

std::optional<double> median_depth(std::span<const Camera> cameras, const PointCloud& points) {
  constexpr std::size_t kCameras = 256, kPoints = 10'000, kFewest = 10;
  std::vector<double> medians;
  for (std::size_t i = 0; i < cameras.size(); i += cameras.size() / kCameras + 1) {
    std::vector<double> depths = depths_seen(cameras[i], points, points.positions.size() / kPoints + 1);
    if (depths.size() >= kFewest) medians.push_back(median_of(depths));
  }
  if (medians.empty()) return std::nullopt;
  return median_of(medians);
}

bool has_free_unit(const ModelVariant& variant) { return variant.cov_param != CovParam::skew_nd; }

void scale_lengths(SplatModel& model, double factor) {
  if (factor == 1) return;
  const ParameterLayout layout = model.layout();
  const auto multiply = [&](int row) {
    for (float& value : model.row(row)) value = static_cast<float>(value * factor);
  };
  for (int axis = 0; axis < 3; ++axis) {
    multiply(layout.xyz + axis);
    for (float& raw : model.row(layout.scale + axis))
      raw = static_cast<float>(inverse_softplus_of(factor * softplus_of(raw)));
  }
  if (model.variant.cov_param == CovParam::cholesky)
    for (int entry = 0; entry < 3; ++entry) multiply(layout.l_triangle + entry);
}

void scale_lengths(Camera& camera, double factor) {
  for (double& value : camera.translation) value *= factor;
}

void scale_lengths(PointCloud& points, double factor) {
  for (auto& position : points.positions)
    for (float& value : position) value = static_cast<float>(value * factor);
}

void scale_lengths(Split& split, double factor) {
  for (View& view : split.views) scale_lengths(view.camera, factor);
}

TrainSettings in_unit(TrainSettings settings) {
  const double unit = std::exchange(settings.unit, 1);
  if (unit == kAuto) return settings;
  for (double* length : {&settings.near_plane, &settings.far_plane, &settings.init_extent})
    if (*length != kAuto) *length /= unit;
  return settings;
}

Split in_unit(const Split& split, double unit) {
  Split out{split.name, {}};
  for (const View& view : split.views) {
    View& scaled = out.views.emplace_back(
        View{view.name, view.camera, {}, view.source, view.masked, view.opaque, view.part_of, view.file});
    scale_lengths(scaled.camera, 1 / unit);
    if (!view.source && view.has_image()) scaled.source = std::make_shared<HeldImage>(view.image);
  }
  return out;
}

}  // namespace ubs
