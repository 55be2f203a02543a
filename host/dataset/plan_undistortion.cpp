// SPDX-License-Identifier: Apache-2.0
// See undistort.hpp. This file contains all functions except the resampling of pixels.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/vector3.hpp"
#include "host/dataset/undistort.hpp"

namespace ubs {
namespace {

// Maximum half size of the ideal image, as a multiple of that of the distorted image. The ideal image of a
// fisheye lens of 180 degrees would be infinitely large, and the border of the distorted image has too little
// detail for so many pixels.
constexpr double kMaxGrowth = 2.0;
constexpr int kBorderSamples = 64;  // number of intervals in which a line of an image is sampled

// Images with a larger angle of view are split into faces. A pinhole image of this angle has three times as
// many pixels per degree at its border as at its centre.
constexpr double kWideDegrees = 110;
constexpr int kSmallestFace = 16;  // [px] minimum side; the window of SSIM alone has 11 pixels
constexpr int kFaceSamples = 256;  // maximum number of samples across a face

// Returns the position in the plane z = 1 that the lens shows at the position (u, v) [px] of the distorted
// image. The result is clamped to `limits` (left, right, top, bottom). If the lens shows no such position,
// returns the nearest limits.
std::array<double, 2> ideal_position(const Lens& lens, double u, double v,
                                     const std::array<double, 4>& limits) {
  double x = u < lens.cx ? limits[0] : limits[1], y = v < lens.cy ? limits[2] : limits[3];
  if (const auto ray = pixel_ray(lens, u, v); ray && (*ray)[2] > 1e-9)
    x = (*ray)[0] / (*ray)[2], y = (*ray)[1] / (*ray)[2];
  return {std::clamp(x, limits[0], limits[1]), std::clamp(y, limits[2], limits[3])};
}

// Returns left, right, top and bottom of a rectangle in the plane z = 1 that the distorted image covers
// completely. Each side of the rectangle belongs to a border of the distorted image, which is sampled. The
// side is at the innermost position that the lens shows at these samples, but not outside of `limits`.
std::array<double, 4> inner_rectangle(const Lens& lens, const std::array<double, 4>& limits) {
  std::array<double, 4> r = limits;
  for (int i = 0; i <= kBorderSamples; ++i) {
    const double u = static_cast<double>(lens.width) * i / kBorderSamples;
    const double v = static_cast<double>(lens.height) * i / kBorderSamples;
    r[0] = std::max(r[0], ideal_position(lens, 0, v, limits)[0]);
    r[1] = std::min(r[1], ideal_position(lens, lens.width, v, limits)[0]);
    r[2] = std::max(r[2], ideal_position(lens, u, 0, limits)[1]);
    r[3] = std::min(r[3], ideal_position(lens, u, lens.height, limits)[1]);
  }
  return r;
}

struct Face {
  const char* name;
  RotationMatrix rotation;  // its rows are the directions right, down and forward of the face, in camera axes
};
constexpr Face kFaces[] = {
    {"front", {1, 0, 0, 0, 1, 0, 0, 0, 1}},  {"right", {0, 0, -1, 0, 1, 0, 1, 0, 0}},
    {"back", {-1, 0, 0, 0, 1, 0, 0, 0, -1}}, {"left", {0, 0, 1, 0, 1, 0, -1, 0, 0}},
    {"up", {1, 0, 0, 0, 0, 1, 0, -1, 0}},    {"down", {1, 0, 0, 0, 0, -1, 0, 1, 0}},
};

Ray from_face(const RotationMatrix& face, const Ray& ray) { return rotated(transposed(face), ray); }

double angle_to_axis(const Ray& ray) { return std::atan2(std::hypot(ray[0], ray[1]), ray[2]); }

// Returns the largest angle to the optical axis that can be used. Up to this angle, the distance from the
// principal point grows with the angle in all directions. For larger angles, the polynomial of the lens maps
// some rays back into the image.
double largest_angle(const Lens& lens) {
  if (lens.formula && lens.formula->all_directions) return std::numbers::pi;
  constexpr int kDirections = 16, kSteps = 720;
  int least = kSteps;
  for (int d = 0; d < kDirections; ++d) {
    const double turn = 2 * std::numbers::pi * d / kDirections;
    double before = -1;
    for (int step = 0; step < least; ++step) {
      const double angle = std::numbers::pi * step / kSteps;
      const auto p = project_ray(
          lens, {std::sin(angle) * std::cos(turn), std::sin(angle) * std::sin(turn), std::cos(angle)});
      const double distance =
          p ? std::hypot(((*p)[0] - lens.cx) / lens.fx, ((*p)[1] - lens.cy) / lens.fy) : -1;
      if (!(distance > before)) least = step - 1;
      before = distance;
    }
  }
  return std::numbers::pi * least / kSteps;
}

// Returns the position of a ray in the image [px], or nullopt if the lens does not show the ray, or if the
// position is less than `margin` pixels away from the border of the image. The border does not matter for
// lenses that show all directions.
std::optional<PlanePoint> seen(const Lens& lens, double max_angle, const Ray& ray, double margin = 0) {
  const bool all = lens.formula && lens.formula->all_directions;
  if (!all && angle_to_axis(ray) > max_angle) return std::nullopt;
  const auto p = project_ray(lens, ray);
  const bool inside = p && (*p)[0] >= margin && (*p)[0] <= lens.width - margin && (*p)[1] >= margin &&
                      (*p)[1] <= lens.height - margin;
  return inside || all ? p : std::nullopt;
}

// Returns the number of pixels per radian around a ray, in the direction in which it is smallest. This is the
// smaller singular value of the derivative of the projection, computed by small steps perpendicular to the
// ray. Returns 0 if the lens does not show a ray of such a step.
double resolution(const Lens& lens, const Ray& ray) {
  const Ray z = normalised(ray), x = perpendicular(z), y = cross(z, x);
  constexpr double kStep = 1e-4;
  double j[2][2] = {};
  const Ray axes[2] = {x, y};
  for (int a = 0; a < 2; ++a) {
    const auto p = project_ray(lens, z + kStep * axes[a]), q = project_ray(lens, z - kStep * axes[a]);
    if (!p || !q) return 0;
    for (std::size_t c = 0; c < 2; ++c) j[c][a] = ((*p)[c] - (*q)[c]) / (2 * kStep);
  }
  const double sum = j[0][0] * j[0][0] + j[0][1] * j[0][1] + j[1][0] * j[1][0] + j[1][1] * j[1][1];
  const double det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
  return std::sqrt(std::max(0.0, (sum - std::sqrt(std::max(0.0, sum * sum - 4 * det * det))) / 2));
}

// Returns the angle to the optical axis of the outermost valid ray on the line from the principal point to a
// position at the border.
double border_angle(const Lens& lens, double column, double row) {
  for (int step = kBorderSamples; step > 0; --step) {
    const double part = static_cast<double>(step) / kBorderSamples;
    if (const auto ray =
            pixel_ray(lens, lens.cx + part * (column - lens.cx), lens.cy + part * (row - lens.cy)))
      return angle_to_axis(*ray);
  }
  return 0;
}

// Returns the resolution of the image [px per radian] at the visible ray that is nearest to the centre of the
// face, or 0 if no ray of the face is visible.
double face_resolution(const Lens& lens, const Face& face, double max_angle) {
  constexpr int kGrid = 64;
  std::vector<std::pair<double, Ray>> rays;
  for (int j = 0; j <= kGrid; ++j)
    for (int i = 0; i <= kGrid; ++i) {
      const double x = 2.0 * i / kGrid - 1, y = 2.0 * j / kGrid - 1;
      rays.push_back({x * x + y * y, from_face(face.rotation, {x, y, 1})});
    }
  std::ranges::stable_sort(rays, {}, &std::pair<double, Ray>::first);
  for (const auto& [distance, ray] : rays)
    if (seen(lens, max_angle, ray)) {
      // The derivative is not defined at the poles of an equirectangular image, so also try a ray next to it.
      const Ray beside = ray + Ray{0.02, 0.01, 0.005};
      return std::max(resolution(lens, ray), resolution(lens, beside));
    }
  return 0;
}

std::optional<Undistortion> plan_face(const Lens& lens, const Face& face, double max_angle,
                                      const std::string& where) {
  const double focal = face_resolution(lens, face, max_angle);
  if (!(focal < 16384)) fail(ErrorKind::data, "{}: the distortion parameters leave no usable image", where);
  const int size = static_cast<int>(std::lround(2 * focal));
  if (size < kSmallestFace) return std::nullopt;
  const double half = size / 2.0;
  const int step = std::max(1, size / kFaceSamples), samples = (size + step - 1) / step;
  int left = size, right = 0, top = size, bottom = 0;
  bool whole = true;
  for (int b = 0; b <= samples; ++b)
    for (int a = 0; a <= samples; ++a) {
      const int i = std::min(a * step, size), j = std::min(b * step, size);
      const Ray ray = from_face(face.rotation, {(i - half) / half, (j - half) / half, 1});
      whole = whole && seen(lens, max_angle, ray, 2.0 * step);
      if (!seen(lens, max_angle, ray)) continue;
      left = std::min(left, std::max(0, i - step)), right = std::max(right, std::min(size, i + step));
      top = std::min(top, std::max(0, j - step)), bottom = std::max(bottom, std::min(size, j + step));
    }
  if (right - left < kSmallestFace || bottom - top < kSmallestFace) return std::nullopt;
  Undistortion plan{lens,       right - left,  bottom - top, half,      half, half - left,
                    half - top, face.rotation, face.name,    max_angle, whole};
  return plan;
}

}  // namespace

double degrees_covered(const Lens& lens) {
  if (lens.formula && lens.formula->all_directions) return 360;
  const double column = std::clamp(lens.cx, 0.0, static_cast<double>(lens.width));
  const double row = std::clamp(lens.cy, 0.0, static_cast<double>(lens.height));
  const double across = border_angle(lens, 0, row) + border_angle(lens, lens.width, row);
  const double down = border_angle(lens, column, 0) + border_angle(lens, column, lens.height);
  return std::max(across, down) * 180 / std::numbers::pi;
}

Undistortion plan_undistortion(const Lens& lens, const std::string& where) {
  const std::array<double, 4> limits{-kMaxGrowth * std::max(lens.cx, 1.0) / lens.fx,
                                     kMaxGrowth * std::max(lens.width - lens.cx, 1.0) / lens.fx,
                                     -kMaxGrowth * std::max(lens.cy, 1.0) / lens.fy,
                                     kMaxGrowth * std::max(lens.height - lens.cy, 1.0) / lens.fy};
  const std::array<double, 4> r = inner_rectangle(lens, limits);
  Undistortion plan;
  plan.fx = lens.fx, plan.fy = lens.fy;
  plan.lens = lens;
  const double width = std::floor((r[1] - r[0]) * lens.fx + 1e-6),
               height = std::floor((r[3] - r[2]) * lens.fy + 1e-6);
  if (!(width >= 1 && height >= 1) || !(width < 65536 && height < 65536))
    fail(ErrorKind::data, "{}: the distortion parameters leave no usable image", where);
  plan.width = static_cast<int>(width);
  plan.height = static_cast<int>(height);
  plan.cx = -r[0] * lens.fx;
  plan.cy = -r[2] * lens.fy;
  return plan;
}

std::vector<Undistortion> plan_faces(const Lens& lens, const std::string& where) {
  std::vector<Undistortion> plans;
  const double max_angle = largest_angle(lens);
  for (const Face& face : kFaces)
    if (auto plan = plan_face(lens, face, max_angle, where)) plans.push_back(std::move(*plan));
  return plans;
}

std::vector<Undistortion> plan_views(const Lens& lens, const std::string& where) {
  if (degrees_covered(lens) > kWideDegrees)
    if (auto faces = plan_faces(lens, where); !faces.empty()) return faces;
  return {plan_undistortion(lens, where)};
}

Camera camera_of(const Undistortion& plan, Camera pose) {
  Camera camera = pose;
  if (!plan.face.empty()) {
    camera.rotation = product(plan.rotation, pose.rotation);
    camera.translation = rotated(plan.rotation, pose.translation);
  }
  camera.fx = plan.fx, camera.fy = plan.fy, camera.cx = plan.cx, camera.cy = plan.cy;
  camera.width = plan.width, camera.height = plan.height;
  return camera;
}

double percent_left_out(const std::vector<Undistortion>& plans) {
  constexpr int kGrid = 32;
  const Lens& lens = plans.at(0).lens;
  int outside = 0;
  for (int j = 0; j < kGrid; ++j)
    for (int i = 0; i < kGrid; ++i) {
      const auto ray = pixel_ray(lens, (i + 0.5) * lens.width / kGrid, (j + 0.5) * lens.height / kGrid);
      const auto shows = [&](const Undistortion& plan) {
        const Ray r = rotated(plan.rotation, *ray);
        const double column = r[0] / r[2] * plan.fx + plan.cx, row = r[1] / r[2] * plan.fy + plan.cy;
        constexpr double kSlack = 1e-6;  // tolerance for rays on the edge between two faces
        return r[2] > 0 && column >= -kSlack && column <= plan.width + kSlack && row >= -kSlack &&
               row <= plan.height + kSlack;
      };
      outside += !(ray && std::ranges::any_of(plans, shows));
    }
  return 100.0 * outside / (kGrid * kGrid);
}

bool covers(const Undistortion& plan, double column, double row) {
  const Ray ray = from_face(plan.rotation, {(column - plan.cx) / plan.fx, (row - plan.cy) / plan.fy, 1});
  return seen(plan.lens, plan.max_angle, ray).has_value();
}

}  // namespace ubs
