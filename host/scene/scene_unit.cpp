// SPDX-License-Identifier: Apache-2.0
#include "host/scene/scene_unit.hpp"

#include <memory>
#include <utility>

#include "host/base/median.hpp"
#include "host/base/vector3.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs {
namespace {

std::vector<double> depths_seen(const Camera& c, const PointCloud& points, std::size_t step) {
  std::vector<double> depths;
  for (std::size_t i = 0; i < points.positions.size(); i += step) {
    const auto& p = points.positions[i];
    const Vec3 at = rotated(c.rotation, {p[0], p[1], p[2]}) + c.translation;
    const double column = c.fx * at[0] / at[2] + c.cx, row = c.fy * at[1] / at[2] + c.cy;
    if (at[2] > 0 && column > 0 && row > 0 && column < c.width && row < c.height) depths.push_back(at[2]);
  }
  return depths;
}

// HeldImage refers to an image that another view holds in memory, and does not copy it.
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
  for (const Camera& camera : evenly_chosen(cameras, kCameras)) {
    std::vector<double> depths = depths_seen(camera, points, points.positions.size() / kPoints + 1);
    if (depths.size() >= kFewest) medians.push_back(median(std::move(depths)));
  }
  if (medians.empty()) return std::nullopt;
  return median(std::move(medians));
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

Split in_unit(const Split& split, double unit) {
  Split out{split.name, {}};
  for (const View& view : split.views) {
    View& scaled = out.views.emplace_back();  // without the image, which is large
    scaled.name = view.name;
    scaled.camera = view.camera;
    scaled.source = view.source;
    scaled.masked = view.masked;
    scaled.opaque = view.opaque;
    scaled.resampled = view.resampled;
    scaled.part_of = view.part_of;
    scaled.wide = view.wide;
    scaled.turn_in_wide = view.turn_in_wide;
    scaled.file = view.file;
    scaled.background = view.background;
    scale_lengths(scaled.camera, 1 / unit);
    if (!view.source && view.has_image()) scaled.source = std::make_shared<HeldImage>(view.image);
  }
  return out;
}

}  // namespace ubs
