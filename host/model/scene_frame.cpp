// SPDX-License-Identifier: Apache-2.0
#include "host/model/scene_frame.hpp"

#include <algorithm>
#include <numbers>

#include "host/base/error.hpp"
#include "host/scene/camera_rig.hpp"

namespace ubs {
namespace {

constexpr double kFov = 0.87;      // default angle of view [rad]
constexpr double kUnlevel = 1e-3;  // variance of the sine of the roll angle of a hand-held camera
constexpr int kPowerSteps = 4;     // iterations of the inverse power method in mean_up()
// Minimum ratio of the thicknesses of the two layers that scene_frame() compares to find a floor. The ratio
// is 5 for the scene lego, which stands on a plate, and less than 2 for a standing figure and for a street.
constexpr double kFloorRatio = 3;
// If there are no cameras, splats whose distance from the median point is more than this multiple of the
// median distance are ignored, because they are stray splats or surroundings of the photographed object. A
// multiple of 1.26 includes all splats of a uniform ball, and 5.2 all splats of a figure that has seven
// eighths of its splats in its upper half.
constexpr double kBulk = 6;
// The image must show the share kShown of the opacity, and is larger than needed by the factor kMargin.
constexpr double kShown = 0.995, kMargin = 1.05;
// A scene counts as seen from all sides if the angle between neighbouring cameras around it is at most this
// [rad]. It is a little more than 90 degrees, the angle between four cameras on a circle.
constexpr double kWidestGap = 1.75;
// A camera that is almost vertically above or below the centre is on no side of the scene. This is the
// minimum horizontal distance of other cameras from the centre, relative to their distance.
constexpr double kLeastSideways = 0.1;
// Radius of the subject that the first view should show, relative to the median distance of the cameras from
// the point that they look at.
constexpr double kSubject = 0.6;
// Two cameras count as seeing the same amount if the visible shares of the subject differ by at most this.
constexpr double kSameView = 0.02;
constexpr int kAzimuths = 12;                  // number of sides from which the scene must fit into the image
constexpr std::size_t kEnoughSplats = 100000;  // larger models are sampled to at most about this many splats

struct Splat {
  Vec3 at;
  double weight;
};

std::vector<Splat> weighted_splats(const MixedModel& model) {
  const std::size_t step = model.count() / kEnoughSplats + 1;
  std::vector<Splat> splats;
  for (const SplatModel& group : model.groups) {
    const ParameterLayout l = group.layout();
    for (std::size_t i = 0; i < group.count; i += step) {
      const Splat s{{group.row(l.xyz)[i], group.row(l.xyz + 1)[i], group.row(l.xyz + 2)[i]},
                    sigmoid(group.row(l.opacity)[i])};
      if (std::isfinite(length(s.at)) && s.weight > 0) splats.push_back(s);
    }
  }
  return splats;
}

// Returns the q-quantile of the values of the splats, weighted by opacity.
template <typename Value>
double weighted(const std::vector<Splat>& splats, double q, Value value) {
  std::vector<std::pair<double, double>> pairs;
  for (const Splat& s : splats) pairs.emplace_back(value(s), s.weight);
  return weighted_quantile(std::move(pairs), q);
}

// Returns the mean up direction of the cameras. It averages the up axes and does not make the result
// perpendicular to a mean forward direction, because the forward directions of cameras around a scene may
// cancel.
Vec3 mean_up(std::span<const Camera> cameras) {
  Vec3 up{};
  for (const Camera& c : cameras) up = up - camera_axis(c, 1);
  up = normalised(up, -1.0 * camera_axis(cameras[0], 1));
  // A few unevenly placed cameras would tilt the mean. Most cameras are held level, so the up direction is
  // perpendicular to the right axes r of all cameras. It is therefore the eigenvector of the mean of r r^T
  // that has the smallest eigenvalue. If all cameras look in the same direction, two eigenvalues are equally
  // small; then the mean of the up axes, from which the iteration starts, determines the result.
  std::array<Vec3, 3> a{Vec3{kUnlevel, 0, 0}, Vec3{0, kUnlevel, 0}, Vec3{0, 0, kUnlevel}};
  for (const Camera& c : cameras) {
    const Vec3 right = camera_axis(c, 0);
    for (std::size_t r = 0; r < 3; ++r) a[r] = a[r] + right[r] / static_cast<double>(cameras.size()) * right;
  }
  for (int k = 0; k < kPowerSteps; ++k)  // multiplies `up` by the inverse of `a` times its determinant
    up = normalised(up[0] * cross(a[1], a[2]) + up[1] * cross(a[2], a[0]) + up[2] * cross(a[0], a[1]), up);
  return up;
}

Pose mean_pose(std::span<const Camera> cameras) {
  Vec3 position{}, forward{};
  for (const Camera& c : cameras) {
    position = position + 1.0 / static_cast<double>(cameras.size()) * c.centre();
    forward = forward + camera_axis(c, 2);
  }
  return look_at(position, position + normalised(forward, camera_axis(cameras[0], 2)), mean_up(cameras));
}

// Returns the radius, perpendicular to the view direction, within which three quarters of the cameras are.
double mean_spread(std::span<const Camera> cameras, const Pose& mean) {
  std::vector<std::pair<double, double>> distances;
  for (const Camera& c : cameras) {
    const Vec3 d = c.centre() - mean.position;
    distances.emplace_back(std::hypot(dot(d, mean.right()), dot(d, mean.down())), 1.0);
  }
  return weighted_quantile(std::move(distances), 0.75);
}

// Returns the median depth of the splats that the pose sees in the middle of its image.
double focus_depth(const std::vector<Splat>& splats, const Pose& pose, double otherwise) {
  std::vector<std::pair<double, double>> depths;
  const double slope = std::tan(kFov / 2);
  for (const Splat& s : splats) {
    const Vec3 d = s.at - pose.position;
    const double z = dot(d, pose.forward());
    if (z > 0 && std::hypot(dot(d, pose.right()), dot(d, pose.down())) < slope * z)
      depths.emplace_back(z, s.weight);
  }
  const double depth = weighted_quantile(std::move(depths), 0.5);
  return depth > 0 ? depth : otherwise;
}

// Returns typical values of the query dimensions that follow the time: the medians of the means of the
// splats, weighted by opacity. Uses the group of splats that has the most query dimensions.
std::vector<double> typical_extra(const MixedModel& model) {
  std::vector<double> extra;
  for (const SplatModel& group : model.groups) {
    const ParameterLayout l = group.layout();
    const int first = (group.dim >= 6 ? 3 : 0) + 1;
    if (l.query - first <= static_cast<int>(extra.size())) continue;
    extra.clear();
    for (int q = first; q < l.query; ++q) {
      std::vector<std::pair<double, double>> values;
      for (std::size_t i = 0; i < group.count; ++i)
        values.emplace_back(group.row(l.mean + q)[i], sigmoid(group.row(l.opacity)[i]));
      extra.push_back(weighted_quantile(std::move(values), 0.5));
    }
  }
  return extra;
}

Vec3 median_point(const std::vector<Splat>& splats) {
  Vec3 middle{};
  for (std::size_t k = 0; k < 3; ++k)
    middle[k] = weighted(splats, 0.5, [k](const Splat& s) { return s.at[k]; });
  return middle;
}

// Returns the splats that the first view of a model without cameras should show.
std::vector<Splat> bulk_of(const std::vector<Splat>& splats) {
  const Vec3 middle = median_point(splats);
  const double half = weighted(splats, 0.5, [&](const Splat& s) { return length(s.at - middle); });
  std::vector<Splat> bulk;
  for (const Splat& s : splats)
    if (length(s.at - middle) <= kBulk * half) bulk.push_back(s);
  return bulk;
}

// Returns the middle of the box that contains almost all splats. Unlike this point, a median would be nearer
// to the end of the scene that has more splats.
Vec3 middle_of(const std::vector<Splat>& splats) {
  Vec3 middle{};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto at = [&](double q) { return weighted(splats, q, [k](const Splat& s) { return s.at[k]; }); };
    middle[k] = 0.5 * (at(1 - kShown) + at(kShown));
  }
  return middle;
}

// Returns the distance from the centre at which images from all sides, at the elevation of the frame, show
// the splats. If a splat has the coordinates (x, y, z) relative to a camera in the centre, the image of a
// camera that is moved back by d shows the splat if |x| and |y| are at most (z + d) tan(fov / 2).
double showing_distance(const std::vector<Splat>& splats, const SceneFrame& frame, double fov) {
  const double slope = std::tan(fov / 2) / kMargin;
  const Vec3 side = perpendicular(frame.up), other = cross(frame.up, side);
  double distance = 0;
  for (int k = 0; k < kAzimuths; ++k) {
    const double azimuth = 2 * std::numbers::pi * k / kAzimuths;
    const Vec3 away = std::cos(frame.elevation) * (std::cos(azimuth) * side + std::sin(azimuth) * other) +
                      std::sin(frame.elevation) * frame.up;
    const Pose pose = look_at(frame.centre + away, frame.centre, frame.up);
    const Vec3 right = pose.right(), down = pose.down(), forward = pose.forward();
    const double needed = weighted(splats, kShown, [&](const Splat& s) {
      const Vec3 d = s.at - frame.centre;
      return std::max(std::abs(dot(d, right)), std::abs(dot(d, down))) / slope - dot(d, forward);
    });
    distance = std::max(distance, needed);
  }
  return distance;
}

// Returns the direction along a coordinate axis that points away from the floor (see scene_frame), or
// `otherwise` if there is no floor.
Vec3 up_from_floor(const std::vector<Splat>& splats, const Vec3& otherwise) {
  double most = kFloorRatio;
  Vec3 up = otherwise;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto at = [&](double q) {
      return weighted(splats, q, [axis](const Splat& s) { return s.at[axis]; });
    };
    const double low = at(0.25) - at(0.01), high = at(0.99) - at(0.75);
    const double thin = std::min(low, high), thick = std::max(low, high);
    if (!(thick > most * thin)) continue;
    most = thin > 0 ? thick / thin : HUGE_VAL;
    up = {};
    up[axis] = low < high ? 1 : -1;
  }
  return up;
}

// Returns whether the cameras are on all sides of the centre of the frame. This is the case if neighbouring
// cameras are never more than kWidestGap apart around the up axis. Cameras that are almost vertically above
// or below the centre are ignored.
bool on_all_sides(const SceneFrame& frame, std::span<const Camera> cameras) {
  const Vec3 side = perpendicular(frame.up), other = cross(frame.up, side);
  std::vector<double> azimuths;
  for (const Camera& c : cameras) {
    const Vec3 away = c.centre() - frame.centre;
    const double x = dot(away, side), y = dot(away, other);
    if (std::hypot(x, y) > kLeastSideways * length(away)) azimuths.push_back(std::atan2(y, x));
  }
  if (azimuths.empty()) return false;
  std::ranges::sort(azimuths);
  double widest = 2 * std::numbers::pi - (azimuths.back() - azimuths.front());
  for (std::size_t i = 1; i < azimuths.size(); ++i) widest = std::max(widest, azimuths[i] - azimuths[i - 1]);
  return widest <= kWidestGap;
}

bool is_visible(const Vec3& at, const Camera& c) {
  const Vec3 d = at - c.centre();
  const double depth = dot(d, camera_axis(c, 2));
  if (!(depth > 0)) return false;
  const double x = c.fx * dot(d, camera_axis(c, 0)) / depth + c.cx,
               y = c.fy * dot(d, camera_axis(c, 1)) / depth + c.cy;
  return x >= 0 && x <= c.width && y >= 0 && y <= c.height;
}

// Returns the splats of the subject (see start_camera).
std::vector<Splat> subject_of(const MixedModel& model, std::span<const Camera> cameras) {
  std::vector<Splat> splats = weighted_splats(model);
  const std::optional<Vec3> meeting = cameras.size() > 1 ? meeting_point(cameras) : std::nullopt;
  if (!meeting) return splats;
  const double radius =
      kSubject * median(cameras, [&](const Camera& c) { return length(c.centre() - *meeting); });
  std::vector<Splat> near;
  for (const Splat& s : splats)
    if (length(s.at - *meeting) <= radius) near.push_back(s);
  return near.empty() ? splats : near;
}

void use_cameras(SceneFrame& frame, std::span<const Camera> cameras) {
  frame.distance = median(cameras, [&](const Camera& c) { return length(c.centre() - frame.centre); });
  frame.elevation = median(cameras, [&](const Camera& c) {
    return std::asin(std::clamp(dot(normalised(c.centre() - frame.centre), frame.up), -1.0, 1.0));
  });
  frame.mean = mean_pose(cameras);
}

}  // namespace

std::vector<Camera> noted_cameras(const MixedModel& model, std::vector<Camera> cameras) {
  const std::vector<double> extra = typical_extra(model);
  for (Camera& camera : cameras) camera.extra = extra;
  return cameras;
}

std::size_t start_camera(const MixedModel& model, std::span<const Camera> cameras) {
  const std::vector<Splat> subject = subject_of(model, cameras);
  double whole = 0;
  for (const Splat& s : subject) whole += s.weight;
  std::vector<double> visible;
  for (const Camera& camera : cameras) {
    double& sum = visible.emplace_back(0);
    for (const Splat& s : subject)
      if (is_visible(s.at, camera)) sum += s.weight;
  }
  const double enough = std::ranges::max(visible) - kSameView * whole;
  return static_cast<std::size_t>(std::ranges::find_if(visible, [&](double sum) { return sum >= enough; }) -
                                  visible.begin());
}

Pose orbit_start(const SceneFrame& frame) {
  const Vec3 offset = std::cos(frame.elevation) * frame.start + std::sin(frame.elevation) * frame.up;
  return look_at(frame.centre + frame.distance * offset, frame.centre, frame.up);
}

double weighted_quantile(std::vector<std::pair<double, double>> value_weight, double q) {
  std::erase_if(value_weight, [](const auto& p) { return !std::isfinite(p.first) || !(p.second > 0); });
  if (value_weight.empty()) return 0;
  std::ranges::sort(value_weight);
  double total = 0, sum = 0;
  for (const auto& [value, weight] : value_weight) total += weight;
  for (const auto& [value, weight] : value_weight)
    if ((sum += weight) >= q * total) return value;
  return value_weight.back().first;
}

SceneFrame scene_frame(const MixedModel& model, std::span<const Camera> cameras, const FrameHints& hints) {
  std::vector<Splat> splats = weighted_splats(model);
  if (splats.empty() && cameras.empty())
    fail(ErrorKind::data, "cannot place a camera: the model has no splats, and no data set was given");
  // Stray splats are removed before the up direction is estimated, because they would distort it.
  if (cameras.empty()) splats = bulk_of(splats);
  const std::optional<Vec3> meeting = cameras.size() > 1 ? meeting_point(cameras) : std::nullopt;
  SceneFrame frame;
  if (hints.up)
    frame.up = normalised(*hints.up);
  else
    frame.up = normalised(cameras.empty() ? up_from_floor(splats, hints.up_without_floor) : mean_up(cameras));
  frame.centre = hints.centre      ? *hints.centre
                 : meeting         ? *meeting
                 : cameras.empty() ? middle_of(splats)
                                   : median_point(splats);
  frame.around = meeting && on_all_sides(frame, cameras);
  frame.size = weighted(splats, 0.5, [&](const Splat& s) { return length(s.at - frame.centre); });
  frame.elevation = hints.elevation.value_or(std::numbers::pi / 9);
  if (cameras.empty())
    frame.distance = showing_distance(splats, frame, hints.fov.value_or(kFov));
  else
    use_cameras(frame, cameras);
  frame.distance = hints.distance.value_or(frame.distance > 0 ? frame.distance : 4.0);
  frame.elevation = hints.elevation.value_or(frame.elevation);
  if (!(frame.size > 0)) frame.size = frame.distance / 4;

  const Vec3 first = cameras.empty() ? Vec3{1, 0, 0} : cameras[0].centre() - frame.centre;
  frame.start = normalised(first - dot(first, frame.up) * frame.up, perpendicular(frame.up));
  if (cameras.empty()) frame.mean = orbit_start(frame);
  frame.focus = focus_depth(splats, frame.mean, frame.distance);
  frame.spread = cameras.size() > 1 ? mean_spread(cameras, frame.mean) : 0;
  if (!(frame.spread > 0)) frame.spread = 0.1 * frame.focus;
  frame.extra = cameras.empty() ? typical_extra(model) : cameras[0].extra;
  return frame;
}

}  // namespace ubs
