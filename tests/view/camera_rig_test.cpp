// SPDX-License-Identifier: Apache-2.0
// Tests values that ubs derives from the arrangement of the cameras if the data contain no points: the region
// of the initial splats, the extent of the scene, and the clipping planes. The cameras look inwards, forwards
// or outwards, or contain no information, for example because all are at the same position.
#include "host/scene/camera_rig.hpp"

#include <catch2/catch.hpp>
#include <numbers>

#include "host/scene/extent.hpp"
#include "host/scene/frustum_points.hpp"
#include "host/scene/pose.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/settings/train_settings.hpp"

using namespace ubs;

namespace {

constexpr double kFov = 0.6911112;  // the field of view of the cameras of NeRF Synthetic

Camera camera(const Vec3& at, const Vec3& target, int width = 400, int height = 400) {
  Pose pose = look_at(at, target, {0, 0, 1});
  pose.fov = kFov;
  return camera_at(pose, {width, height, {}});
}

// Returns cameras on half a circle around `centre`, as when walking around an object on a table. If
// `outwards` is true, the cameras look away from the centre.
std::vector<Camera> half_turn(const Vec3& centre, double distance, bool outwards = false) {
  std::vector<Camera> cameras;
  for (int i = 0; i < 58; ++i) {
    const double a = std::numbers::pi * i / 57;
    const Vec3 away{std::cos(a), std::sin(a), 0.3 + 0.2 * std::sin(3 * a)};
    const Vec3 at = centre + distance * normalised(away);
    cameras.push_back(camera(at, outwards ? at + away : centre));
  }
  return cameras;
}

bool usable(const InitialSpace& space) {
  const bool box = space.half > 0 && std::isfinite(space.half + length(space.centre)) && space.near == 0;
  const bool depths = space.half == 0 && space.near > 0 && space.far > space.near && std::isfinite(space.far);
  return (box || depths) && !space.text.empty();
}

}  // namespace

TEST_CASE("initial space: for cameras that look inwards, the space is around the point that they look at") {
  const Vec3 centre{3, -2, 0.5};
  const std::vector<Camera> cameras = half_turn(centre, 4.0311289);
  const InitialSpace box = initial_space(cameras, true);
  CHECK(usable(box));
  CHECK(length(box.centre - centre) < 1e-9);
  CHECK(box.half == Approx(1.3).margin(0.01));  // the value that published methods use for these cameras
  const InitialSpace depths = initial_space(cameras, false);
  CHECK(usable(depths));
  CHECK(depths.near == Approx(0.5 * 4.0311289));
  CHECK(depths.far == Approx(4 * 4.0311289));
  // If the scene is twice as large, the space is twice as large.
  const InitialSpace twice = initial_space(half_turn(2.0 * centre, 2 * 4.0311289), true);
  CHECK(twice.half == Approx(2 * box.half));
  // Images with another aspect ratio give a space that fills the same share of the view.
  std::vector<Camera> portrait;
  for (const Camera& c : cameras) portrait.push_back(camera(c.centre(), centre, 133, 238));
  CHECK(initial_space(portrait, true).half == Approx(1.3 * std::sqrt(238.0 / 133)).epsilon(0.01));
}

TEST_CASE("initial space: cameras that look forwards or outwards give a range of depths") {
  std::vector<Camera> converging, parallel;
  for (int i = 0; i < 20; ++i) {
    const Vec3 at{0.1 * (i % 5 - 2), 0, 0.1 * (i / 5 - 1.5)};
    converging.push_back(camera(3.0 * at, {0, 5, 0}));  // distance / spread is that of the scene fern
    parallel.push_back(camera(at, at + Vec3{0, 1, 0}));
  }
  // The angle between the view directions is too small for cameras around an object, but sufficient to
  // determine the distance of the object.
  const InitialSpace near_by = initial_space(converging, true);
  CHECK(usable(near_by));
  CHECK(near_by.near < 5);
  CHECK(near_by.far > 5);
  const InitialSpace unknown = initial_space(parallel, true);
  CHECK(usable(unknown));
  CHECK_THAT(unknown.text, Catch::Contains("the same direction"));
  // At 2.5 times the distance between neighbouring cameras, which is 0.1, their views overlap.
  CHECK(unknown.near > 0.25);
  const InitialSpace outwards = initial_space(half_turn({0, 0, 0}, 1, true), false);
  CHECK(usable(outwards));
  CHECK_THAT(outwards.text, Catch::Contains("outwards"));
}

TEST_CASE("initial space: one, equal, turning or only two cameras give a usable space") {
  const Camera one = camera({1, 2, 3}, {0, 0, 0});
  CHECK(usable(initial_space(std::vector{one}, true)));
  CHECK(usable(initial_space(std::vector(5, one), false)));
  std::vector<Camera> turning;  // all cameras are at the same position
  for (int i = 0; i < 12; ++i)
    turning.push_back(camera({1, 1, 1}, Vec3{1, 1, 1} + Vec3{std::cos(0.5 * i), std::sin(0.5 * i), 0}));
  for (const bool plain : {false, true}) CHECK(usable(initial_space(turning, plain)));
  const std::vector<Camera> two{camera({0, 0, 0}, {0, 1, 0}), camera({1, 0, 0}, {1, 1, 0})};
  CHECK(usable(initial_space(two, true)));
  const std::vector<Camera> opposite{camera({0, -2, 0}, {0, 0, 0}), camera({0, 2, 0}, {0, 0, 0})};
  CHECK(usable(initial_space(opposite, true)));
}

// Returns a camera for a part of a wide image. The part shows about the same directions as `c`, but its
// principal point is outside the part.
Camera cut_from_wide_image(const Camera& c) {
  // The tangent of the angle between the centre of the part and the forward axis.
  const double right = 3 * c.width / c.fx;
  const double n = std::hypot(1, right), cosine = 1 / n, sine = right / n;
  Camera out = c;
  out.cx = c.cx - right * c.fx;
  out.rotation = product({cosine, 0, sine, 0, 1, 0, -sine, 0, cosine}, c.rotation);
  out.translation = rotated(out.rotation, -1.0 * c.centre());
  return out;
}

// An arrangement of cameras, with values that follow from its construction.
struct Situation {
  std::string name;
  std::vector<Camera> cameras;
  double extent;             // 1.1 times the largest distance of a camera from the mean position
  double nearest, farthest;  // depths of the objects that such cameras usually show, along the forward axis
};

std::vector<Situation> situations() {
  // At this elevation, the distance of a camera from the axis of the ring is 0.8 times its distance from the
  // centre.
  const auto ring = [](double distance, bool outwards) {
    std::vector<Camera> cameras;
    for (int i = 0; i < 40; ++i) {
      const double a = 2 * std::numbers::pi * i / 40;
      const Vec3 at = distance * Vec3{0.8 * std::cos(a), 0.8 * std::sin(a), 0.6};
      cameras.push_back(camera(at, outwards ? 2.0 * at : Vec3{}));
    }
    return cameras;
  };
  std::vector<Camera> forward, parallel, turning;
  for (int i = 0; i < 20; ++i) {
    // A corner of this grid is at a distance of 0.25 from its centre.
    const Vec3 at{0.1 * (i % 5 - 2), 0, 0.1 * (i / 5 - 1.5)};
    forward.push_back(camera(3.0 * at, {0, 5, 0}));
    parallel.push_back(camera(at, at + Vec3{0, 1, 0}));
    turning.push_back(camera({0, 0, 0}, {std::cos(0.3 * i), std::sin(0.3 * i), 0}));
  }
  std::vector<Situation> all{
      {"around an object", ring(4, false), 1.1 * 0.8 * 4, 2.5, 40},
      {"outwards", ring(1, true), 1.1 * 0.8, 0.4, 8},
      {"forward", forward, 1.1 * 0.75, 2.5, 20},
      {"parallel", parallel, 1.1 * 0.25, 0.5, 5},
      {"two side by side", {camera({0, 0, 0}, {0, 1, 0}), camera({1, 0, 0}, {1, 1, 0})}, 1.1 * 0.5, 1, 10},
      {"two opposite", {camera({0, -2, 0}, {0, 0, 0}), camera({0, 2, 0}, {0, 0, 0})}, 1.1 * 2, 1, 3},
      // For the following cameras, the scale of the scene is unknown, so ubs uses depths from 1 to 10 for all
      // data.
      {"turning", turning, 0, 1, 10},
      {"all equal", std::vector(5, parallel[3]), 0, 1, 10},
      {"one", {forward[0]}, 0, 1, 10}};
  for (std::size_t s = 0, n = all.size(); s < n; ++s) {
    Situation part = all[s];
    part.name += ", parts of wide images";
    for (Camera& c : part.cameras) c = cut_from_wide_image(c);
    // The distances are the same, but depths along the forward axis are shorter, because the axis does not
    // point to the objects that a part shows. Depths that are derived only from distances between cameras do
    // not change.
    const double cosine = dot(view_direction(part.cameras[0]), camera_axis(part.cameras[0], 2));
    if (s == 0 || s == 2) part.nearest *= cosine, part.farthest *= cosine;
    all.push_back(part);
  }
  return all;
}

double extent(const std::vector<Camera>& cameras) {
  std::vector<View> views;
  for (const Camera& c : cameras) views.push_back({"v", c, {}, nullptr});
  return scene_extent(views);
}

// Returns the clipping planes that training uses if the data have no points. The unit is chosen as in
// choose_unit().
Planes planes(const std::vector<Camera>& cameras) {
  TrainSettings settings;
  settings.unit = initial_space(cameras, false).depth;
  return planes_of(settings);
}

TEST_CASE("camera rigs: extent, clipping planes and initial splats fit every arrangement of cameras") {
  for (const Situation& s : situations()) {
    INFO(s.name);
    CHECK(at_one_place(s.cameras) == (s.extent == 0));
    CHECK(extent(s.cameras) == Approx(s.extent).margin(1e-12));
    // The near plane must be much nearer than the objects in the images, but not so near that splats directly
    // in front of a camera, which no other camera sees, are visible.
    const auto [near, far] = planes(s.cameras);
    CHECK(near < s.nearest / 10);
    CHECK(near > s.nearest / 1000);
    CHECK(far > 10 * s.farthest);
    for (const bool plain : {false, true}) {
      const InitialSpace space = initial_space(s.cameras, plain);
      REQUIRE(usable(space));
      // A range of depths must be between the clipping planes, and must overlap with the depths of the
      // objects. A box must be beyond the near plane of every camera.
      if (space.half == 0) {
        CHECK(near < space.near);
        CHECK(far > space.far);
        CHECK(space.near < s.farthest);
        CHECK(space.far > s.nearest);
      } else {
        for (const Camera& c : s.cameras)
          for (int corner = 0; corner < 8; ++corner) {
            const auto side = [&](int bit) { return (corner >> bit & 1) != 0 ? space.half : -space.half; };
            const Vec3 at = space.centre + Vec3{side(0), side(1), side(2)} - c.centre();
            CHECK(dot(at, camera_axis(c, 2)) > near);
          }
      }
    }
  }
}

TEST_CASE("camera rigs: results scale with the data and do not depend on their position") {
  for (const Situation& s : situations())
    for (const bool plain : {false, true}) {
      const InitialSpace expected = initial_space(s.cameras, plain);
      const Planes clipping = planes(s.cameras);
      const auto check = [&](const std::vector<Camera>& others, double factor) {
        const InitialSpace space = initial_space(others, plain);
        // If all cameras are at one position, the scale is unknown, and the same depths are chosen for all
        // data.
        const double f = at_one_place(s.cameras) ? 1 : factor;
        CHECK(space.half == Approx(f * expected.half).epsilon(1e-9));
        CHECK(space.near == Approx(f * expected.near).epsilon(1e-9));
        CHECK(space.far == Approx(f * expected.far).epsilon(1e-9));
        CHECK(space.depth == Approx(f * expected.depth).epsilon(1e-9));
        CHECK(planes(others).near == Approx(f * clipping.near).epsilon(1e-9));
        CHECK(planes(others).far == Approx(f * clipping.far).epsilon(1e-9));
        CHECK(extent(others) == Approx(factor * s.extent).epsilon(1e-9).margin(1e-12));
      };
      for (const double factor : {1e-6, 1e-3, 1e3, 1e6}) {
        INFO(s.name << ", times " << factor);
        std::vector<Camera> scaled = s.cameras;
        for (Camera& c : scaled) scale_lengths(c, factor);
        check(scaled, factor);
      }
      INFO(s.name << ", at another position");
      std::vector<Camera> moved = s.cameras;
      for (Camera& c : moved) c.translation = c.translation - rotated(c.rotation, {70, -30, 11});
      check(moved, 1);
    }
}

TEST_CASE("initial space: parts of wide images give the centre of the whole images") {
  const InitialSpace box = initial_space(half_turn({3, -2, 0.5}, 4), true);
  std::vector<Camera> parts;
  for (const Camera& c : half_turn({3, -2, 0.5}, 4)) parts.push_back(cut_from_wide_image(c));
  const double cosine = dot(view_direction(parts[0]), camera_axis(parts[0], 2));
  CHECK(cosine < 0.5);
  const InitialSpace part = initial_space(parts, true);
  CHECK(length(part.centre - box.centre) < 1e-9);
  CHECK(part.depth == Approx(cosine * box.depth));
  CHECK(part.half == Approx(cosine * box.half));
}

TEST_CASE("points in frusta get the colours of their pixels") {
  View view{"v", camera({0, -4, 0}, {0, 0, 0}, 40, 20), {40, 20, {}, {}}, nullptr};
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 40; ++x)
      for (const int c : {6 * x, 12 * y, 200}) view.image.rgb.push_back(static_cast<std::uint8_t>(c));
  const std::array<double, 2> depths{2, 16};
  const PointCloud cloud =
      sample_frusta(std::span(&view, 1), std::span(&depths, 1), 500, 7, PointColours::pixels);
  REQUIRE(cloud.positions.size() == 500);
  for (std::size_t i = 0; i < 500; ++i) {
    const auto& p = cloud.positions[i];
    double at[3];
    for (std::size_t r = 0; r < 3; ++r) {
      at[r] = view.camera.translation[r];
      for (std::size_t k = 0; k < 3; ++k)
        at[r] += view.camera.rotation[3 * r + k] * static_cast<double>(p[k]);
    }
    const double x = view.camera.fx * at[0] / at[2] + view.camera.cx,
                 y = view.camera.fy * at[1] / at[2] + view.camera.cy;
    // The positions are rounded to float, which moves them by about 1e-6 pixels.
    CHECK(std::abs(cloud.colours[i][0] / 6 + 0.5 - x) < 0.51);
    CHECK(std::abs(cloud.colours[i][1] / 12 + 0.5 - y) < 0.51);
    CHECK(cloud.colours[i][2] == 200);
  }
  // The positions are the same as without colours.
  CHECK(sample_frusta(std::span(&view, 1), std::span(&depths, 1), 500, 7).positions == cloud.positions);
}
