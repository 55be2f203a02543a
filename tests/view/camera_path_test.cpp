// SPDX-License-Identifier: Apache-2.0
// Tests poses, camera paths, and SceneFrame. A SceneFrame contains the estimated centre, up direction and
// size of a scene, and camera paths are computed from it.
#include "host/model/camera_path.hpp"

#include <catch2/catch.hpp>
#include <numbers>

#include "host/formats/splat_file.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "tests/support/data.hpp"
#include "tests/support/temp_folder.hpp"
#include "tests/view/distance.hpp"

using namespace ubs;
using test::distance;

namespace {

constexpr double kDegree = std::numbers::pi / 180;
// Bound of rounding errors in double precision. The largest error observed here was 1.3e-15.
constexpr double kExact = 3e-15;

// Returns the angle between two rotations.
double angle(const Quaternion& a, const Quaternion& b) {
  const auto m = matrix(a), n = matrix(b);
  double sum = 0;
  for (std::size_t i = 0; i < 9; ++i) sum += (m[i] - n[i]) * (m[i] - n[i]);
  return std::sqrt(sum / 2);
}

SceneFrame tilted_frame() {
  SceneFrame frame;
  frame.centre = {1, -2, 0.5};
  frame.up = normalised({0.2, -0.9, 0.3});
  frame.start = perpendicular(frame.up);
  frame.distance = 3;
  frame.elevation = 25 * kDegree;
  frame.mean = look_at({4, 1, 2}, frame.centre, frame.up);
  frame.focus = 4.5;
  frame.spread = 0.4;
  return frame;
}

// Returns the sine of the angle between the view direction and the direction to the point.
double miss(const Pose& pose, const Vec3& target) {
  return length(cross(pose.forward(), normalised(target - pose.position)));
}

}  // namespace

TEST_CASE("pose: look_at() gives the right pose, and conversion to a camera and back does not change it") {
  Random random(5);
  for (int i = 0; i < 200; ++i) {
    const auto number = [&] { return random.uniform(-1, 1); };
    const Vec3 position{number(), number(), number()}, target{number(), number(), number()};
    const Vec3 up{number(), number(), number()};
    Pose pose = look_at(position, target, up);
    pose.time = 0.25;
    CHECK(distance(pose.forward(), normalised(target - position)) < kExact);
    CHECK(distance(cross(pose.right(), pose.down()), pose.forward()) < kExact);
    CHECK(dot(pose.down(), up) <= 0);
    CHECK(std::abs(dot(pose.right(), up)) < kExact);
    const Camera camera = camera_at(pose, {64, 48, {0.5}});
    CHECK(distance(camera.centre(), position) < kExact);
    const Pose back = pose_of(camera);
    CHECK(angle(back.rotation, pose.rotation) < kExact);
    CHECK(back.fov == Approx(pose.fov).epsilon(1e-12));
    CHECK(back.time == 0.25);
  }
  // If the target is straight above the position or equal to it, the result must still be a rotation.
  for (const Vec3& target : {Vec3{0, 0, 5}, Vec3{0, 0, 0}}) {
    const Pose pose = look_at({0, 0, 0}, target, {0, 0, 1});
    CHECK(distance(cross(pose.right(), pose.down()), pose.forward()) < kExact);
  }
}

TEST_CASE("slerp() interpolates rotations with constant speed along the shorter arc") {
  const Pose a = look_at({0, 0, 0}, {1, 0, 0}, {0, 0, 1}), b = look_at({0, 0, 0}, {-0.2, 1, 0.3}, {0, 0, 1});
  const Quaternion negative{-b.rotation.w, -b.rotation.x, -b.rotation.y, -b.rotation.z};
  CHECK(angle(slerp(a.rotation, b.rotation, 0), a.rotation) < kExact);
  CHECK(angle(slerp(a.rotation, b.rotation, 1), b.rotation) < kExact);
  const double step = angle(slerp(a.rotation, b.rotation, 0), slerp(a.rotation, b.rotation, 0.01));
  CHECK(step > 0.01);
  for (int i = 0; i < 100; ++i) {
    const double s = i / 100.0;
    CHECK(angle(slerp(a.rotation, b.rotation, s), slerp(a.rotation, b.rotation, s + 0.01)) ==
          Approx(step).epsilon(1e-9));
    CHECK(angle(slerp(a.rotation, b.rotation, s), slerp(a.rotation, negative, s)) < kExact);
  }
}

TEST_CASE("orbit: the path is closed, has a constant distance and elevation, and looks at the centre") {
  const SceneFrame frame = tilted_frame();
  for (const double loops : {1.0, 3.0, -1.0}) {
    const auto path = orbit_path(frame, 0.7, loops);
    CHECK(path->closed());
    CHECK(distance(path->at(0).position, path->at(1).position) < 1e-13);
    double way = 0;
    for (const double u : path_moments(60, true)) {
      const Pose pose = path->at(u), next = path->at(u + 1.0 / 60);
      CHECK(pose.fov == 0.7);
      CHECK(distance(pose.position, frame.centre) == Approx(3).epsilon(1e-12));
      CHECK(dot(pose.position - frame.centre, frame.up) == Approx(3 * std::sin(25 * kDegree)).epsilon(1e-12));
      CHECK(miss(pose, frame.centre) < kExact);
      CHECK(dot(pose.down(), frame.up) < 0);
      way += distance(pose.position, next.position);
    }
    const double circumference = 2 * std::numbers::pi * 3 * std::cos(25 * kDegree) * std::abs(loops);
    CHECK(way == Approx(circumference).epsilon(0.01));
  }
  CHECK(!orbit_path(frame, 0.7, 0.5)->closed());
  CHECK(distance(orbit_path(frame, 0.7, 1)->at(0.1).position, orbit_path(frame, 0.7, -1)->at(0.9).position) <
        1e-13);
}

TEST_CASE("spiral: the path is closed, stays near the mean pose, and looks at its focus") {
  const SceneFrame frame = tilted_frame();
  const auto path = spiral_path(frame, 0.7, 2);
  const Vec3 target = frame.mean.position + 4.5 * frame.mean.forward();
  CHECK(path->closed());
  CHECK(distance(path->at(0).position, path->at(1).position) < 1e-13);
  double low = 1, high = -1;
  for (const double u : path_moments(100, true)) {
    const Pose pose = path->at(u);
    const Vec3 offset = pose.position - frame.mean.position;
    CHECK(std::hypot(dot(offset, frame.mean.right()), dot(offset, frame.mean.down())) ==
          Approx(0.4).epsilon(1e-9));
    CHECK(miss(pose, target) < kExact);
    low = std::min(low, dot(offset, frame.mean.forward()));
    high = std::max(high, dot(offset, frame.mean.forward()));
    CHECK(distance(pose.position, path->at(u + 0.01).position) < 0.1);
  }
  CHECK(low == Approx(-0.4 / 3).epsilon(0.01));
  CHECK(high == Approx(0.4 / 3).epsilon(0.01));
}

TEST_CASE("keyframes: the path passes exactly through keyframes, without jumps or kinks") {
  std::vector<Pose> keys;
  Random random(9);
  for (int i = 0; i < 6; ++i) {
    const auto number = [&] { return random.uniform(-1, 1); };
    keys.push_back(look_at({3 * number(), 3 * number(), 3 * number()}, {number(), number(), 5}, {0, -1, 0}));
    keys.back().fov = 0.5 + 0.1 * i;
    keys.back().time = i / 5.0;
  }
  for (const bool closed : {false, true}) {
    const auto path = keyframe_path(keys, closed, true);
    CHECK(path->closed() == closed);
    CHECK(path->has_time());
    const int segments = closed ? 6 : 5;
    for (int i = 0; i <= segments; ++i) {
      const Pose pose = path->at(static_cast<double>(i) / segments);
      const Pose& key = keys[static_cast<std::size_t>(i % 6)];
      CHECK(distance(pose.position, key.position) < 1e-14);
      CHECK(angle(pose.rotation, key.rotation) < 1e-14);
      CHECK(pose.fov == Approx(key.fov).epsilon(1e-14));
      CHECK(pose.time == Approx(key.time).margin(1e-14));
    }
    const double h = 1e-4;
    const auto velocity = [&](double u) { return 1 / h * (path->at(u + h).position - path->at(u).position); };
    for (double u = h; u < 1 - 3 * h; u += h) {
      CHECK(distance(path->at(u).position, path->at(u + h).position) < 98 * h);  // observed: at most 49 h
      // The observed acceleration is at most 713. At a kink, the velocity would change by about 10 at once.
      CHECK(distance(velocity(u), velocity(u + h)) < 1400 * h);
    }
  }
  CHECK(distance(keyframe_path({keys[2]}, true, false)->at(0.7).position, keys[2].position) == 0);
}

TEST_CASE("path_moments() does not repeat the start of a closed path at its end") {
  CHECK(path_moments(4, true) == std::vector<double>{0, 0.25, 0.5, 0.75});
  CHECK(path_moments(5, false) == std::vector<double>{0, 0.25, 0.5, 0.75, 1});
  CHECK(path_moments(1, false) == std::vector<double>{0});
}

TEST_CASE("weighted_quantile() uses the weights, and ignores NaN and values with the weight 0") {
  CHECK(weighted_quantile({{3, 1}, {1, 1}, {2, 1}}, 0.5) == 2);
  CHECK(weighted_quantile({{1, 1}, {2, 1}, {100, 5}}, 0.5) == 100);
  CHECK(weighted_quantile({{1, 0}, {2, 1}, {NAN, 9}}, 0.0) == 2);
  CHECK(weighted_quantile({}, 0.5) == 0);
}

TEST_CASE("scene frame: for cameras on an orbit, the frame has the centre and the shape of this orbit") {
  std::vector<Camera> cameras;
  const Vec3 centre{0.5, 2, -1}, up = normalised({0, -1, 0.2});
  SceneFrame around;
  around.centre = centre;
  around.up = up;
  around.start = perpendicular(up);
  around.distance = 4;
  around.elevation = 0.4;
  const auto orbit = orbit_path(around, 0.8, 1);
  for (const double u : path_moments(12, true)) cameras.push_back(camera_at(orbit->at(u), {}));
  const SceneFrame frame = scene_frame(MixedModel(SplatModel(3, 0)), cameras);
  // The centre is the point nearest to 12 rays, which intersect here. Observed error: 2e-15.
  CHECK(distance(frame.centre, centre) < 1e-14);
  CHECK(distance(frame.up, up) < 1e-14);
  CHECK(frame.distance == Approx(4).epsilon(1e-12));
  CHECK(frame.elevation == Approx(0.4).epsilon(1e-12));
  CHECK(distance(frame.start, around.start) < 1e-14);
  CHECK(distance(orbit_path(frame, 0.8, 1)->at(0.3).position, orbit->at(0.3).position) < 1e-13);

  const SceneFrame told =
      scene_frame(MixedModel(SplatModel(3, 0)), cameras,
                  {.centre = Vec3{0, 0, 0}, .up = Vec3{0, 0, 2}, .distance = 7, .elevation = -0.1});
  CHECK(distance(told.centre, {0, 0, 0}) == 0);
  CHECK(distance(told.up, {0, 0, 1}) == 0);
  CHECK(told.distance == 7);
  CHECK(told.elevation == -0.1);
}

TEST_CASE("scene frame: an orbit is only suitable for cameras on all sides") {
  const auto seen_around = [](double turn, int count) {
    std::vector<Camera> cameras;
    for (int i = 0; i < count; ++i) {
      const double azimuth = turn * i / (turn < 6 ? count - 1 : count);
      cameras.push_back(camera_at(
          look_at({1 + 4 * std::cos(azimuth), 2 + 4 * std::sin(azimuth), 1.5}, {1, 2, 0}, {0, 0, 1}), {}));
    }
    return scene_frame(MixedModel(SplatModel(3, 0)), cameras).around;
  };
  constexpr double kTurn = 2 * std::numbers::pi;
  CHECK(seen_around(kTurn, 12));
  CHECK(seen_around(kTurn, 4));
  CHECK(seen_around(0.75 * kTurn, 12));  // a gap of 90 degrees
  CHECK_FALSE(seen_around(kTurn / 2, 12));
  CHECK_FALSE(seen_around(kTurn, 3));
}

// Returns a figure with a height of 2, and a room around it. Two thirds of the splats are in the room.
MixedModel figure_in_room() {
  SplatModel model(3, 3000);
  Random random(7);
  for (std::size_t i = 0; i < model.count; ++i)
    for (int k = 0; k < 3; ++k) {
      const double t = random.uniform(-1, 1);
      model.row(k)[i] = static_cast<float>(i % 3 == 0 ? (k == 2 ? t : 0.2 * t) : 8 * t);
    }
  return MixedModel(model);
}

TEST_CASE("start camera: the first camera that shows the whole subject is chosen") {
  const double fov = 0.7;  // shows a height of 2.2 from a distance of 3
  std::vector<Camera> cameras;
  const auto add = [&](double azimuth, double distance, double height) {
    const Vec3 at{distance * std::cos(azimuth), distance * std::sin(azimuth), height};
    Pose pose = look_at(at, {0, 0, height}, {0, 0, 1});
    pose.fov = fov;
    cameras.push_back(camera_at(pose, {.width = 64, .height = 64, .extra = {}}));
  };
  add(0, 2.5, 0);  // too close to show the whole figure
  add(1.5, 3, 0.5);
  add(3, 3.5, 0);
  add(4.5, 3.6, 0);
  CHECK(start_camera(figure_in_room(), cameras) == 2);
  // If several cameras show the whole figure, the first one is chosen.
  std::swap(cameras[2], cameras[3]);
  CHECK(start_camera(figure_in_room(), cameras) == 2);
  // A single camera does not determine the point that cameras look at, so the subject consists of all splats.
  CHECK(start_camera(figure_in_room(), std::span(cameras).first(1)) == 0);
  CHECK(start_camera(MixedModel(SplatModel(3, 0)), cameras) == 0);
}

// The cameras of D-NeRF scenes are distributed randomly over a hemisphere, so that the mean of their up axes
// is tilted by 24 degrees. The up direction of the frame must not be tilted.
TEST_CASE("scene frame: the up direction is correct for unevenly distributed cameras") {
  const Vec3 up{0, 0, 1};
  std::vector<Camera> cameras;
  for (const auto& [azimuth, elevation] :
       {std::pair{0.1, 1.2}, {0.5, 0.9}, {0.9, 1.3}, {1.1, 0.3}, {1.6, 1.1}, {4.0, 0.2}}) {
    const Vec3 at{4 * std::cos(elevation) * std::cos(azimuth), 4 * std::cos(elevation) * std::sin(azimuth),
                  4 * std::sin(elevation)};
    cameras.push_back(camera_at(look_at(at, {0, 0, 0}, up), {}));
  }
  const SceneFrame frame = scene_frame(MixedModel(SplatModel(3, 0)), cameras);
  CHECK(distance(frame.up, up) < 1e-6);  // four steps of the inverse power method are not exact
  // If all cameras are at one position, only the mean can be used.
  const std::vector<Camera> same(3, cameras[0]);
  const Vec3 leaning = scene_frame(MixedModel(SplatModel(3, 0)), same).up;
  CHECK(leaning[2] == Approx(std::cos(1.2)).epsilon(1e-6));
}

TEST_CASE("scene frame: distant and faint splats do not move the centre") {
  SplatModel model(6, 1000);
  Random random(3);
  for (std::size_t i = 0; i < model.count; ++i) {
    const bool stray = i % 5 == 0, faint = i % 5 == 1;
    for (int k = 0; k < 3; ++k)
      model.row(k)[i] = static_cast<float>(stray ? 1000 : faint ? 50 : 10 * k + random.uniform(-1, 1));
    model.row(model.layout().opacity)[i] = faint ? -12.0f : 0.0f;
  }
  const SceneFrame frame = scene_frame(MixedModel(model), {}, {.fov = 0.8});
  CHECK(distance(frame.centre, {0, 10, 20}) < 0.8);
  CHECK(frame.size > 0.5);
  CHECK(frame.size < 2);
  CHECK(frame.up == Vec3{0, 0, 1});
  CHECK(distance(frame.mean.position, frame.centre) == Approx(frame.distance));
  CHECK(test::message_of([] { scene_frame(MixedModel(SplatModel(3, 0)), {}); }).find("no splats") !=
        std::string::npos);
}

// Returns the share of the opacity that is inside the image, for the camera of an orbit that shows the least.
double least_shown(const SplatModel& model, const SceneFrame& frame, int width, int height, double fov) {
  double least = 1;
  const auto orbit = orbit_path(frame, fov, 1);
  for (const double u : path_moments(24, true)) {
    const Camera camera = camera_at(orbit->at(u), {width, height, {}});
    double inside = 0, all = 0;
    for (std::size_t i = 0; i < model.count; ++i) {
      std::array<double, 3> p = camera.translation;
      for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t c = 0; c < 3; ++c)
          p[r] += camera.rotation[3 * r + c] * static_cast<double>(model.row(static_cast<int>(c))[i]);
      const double x = camera.fx * p[0] / p[2] + camera.cx, y = camera.fy * p[1] / p[2] + camera.cy;
      const double weight = 1 / (1 + std::exp(-static_cast<double>(model.row(model.layout().opacity)[i])));
      all += weight;
      if (p[2] > 0 && x > 0 && x < width && y > 0 && y < height) inside += weight;
    }
    least = std::min(least, inside / all);
  }
  return least;
}

// A quarter of the splats are opaque floaters. All of them are on one side, at 10 to 100 times the size of
// the scene.
TEST_CASE("scene frame: floaters at more than ten times the size of the scene have no influence") {
  constexpr std::size_t kScene = 3000, kFloaters = 1000;
  SplatModel clean(3, kScene), strewn(3, kScene + kFloaters);
  Random random(11);
  for (std::size_t i = 0; i < strewn.count; ++i) {
    const bool floater = i >= kScene;
    for (int k = 0; k < 3; ++k) {
      const double at = random.uniform(-1, 1) + (floater && k == 0 ? random.uniform(11, 100) : 0.0);
      if (!floater) clean.row(k)[i] = static_cast<float>(at);
      strewn.row(k)[i] = static_cast<float>(at);
    }
    if (floater) strewn.row(strewn.layout().opacity)[i] = 5;
  }
  std::vector<Camera> around;
  for (int i = 0; i < 12; ++i) {
    const double a = 2 * std::numbers::pi * i / 12;
    around.push_back(
        camera_at(look_at({4 * std::cos(a), 4 * std::sin(a), 2}, {0, 0, 0}, {0, 0, 1}), {64, 64, {}}));
  }
  for (const std::vector<Camera>& cameras : {std::vector<Camera>{}, around}) {
    const FrameHints hints{.fov = 0.8};
    const SceneFrame a = scene_frame(MixedModel(clean), cameras, hints),
                     b = scene_frame(MixedModel(strewn), cameras, hints);
    INFO(cameras.size() << " cameras");
    CHECK(distance(a.centre, b.centre) < 0.1);
    CHECK(distance(a.up, b.up) < 1e-9);
    CHECK(b.distance == Approx(a.distance).epsilon(0.05));
    CHECK(distance(a.mean.position, b.mean.position) < 0.2);
    CHECK(b.focus == Approx(a.focus).epsilon(0.1));
    if (cameras.empty()) CHECK(least_shown(clean, b, 64, 64, 0.8) > 0.99);
  }
}

TEST_CASE("scene frame: without cameras, a slender model is completely inside the image") {
  // The first model is a figure with a size of 0.4 x 0.3 x 4, whose splats are mostly in its upper half. The
  // second model is flat.
  for (const std::array<double, 3>& extent : {std::array<double, 3>{0.4, 0.3, 4}, {5, 4, 0.2}}) {
    SplatModel model(3, 4000);
    Random random(6);
    for (std::size_t i = 0; i < model.count; ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        double t = random.uniform(0, 1);
        if (k == 2 && i % 8 != 0) t = 0.5 + 0.5 * t;
        model.row(static_cast<int>(k))[i] = static_cast<float>(extent[k] * (t - 0.5) + 7);
      }
    const SceneFrame frame = scene_frame(MixedModel(model), {}, {.fov = 0.6});
    CAPTURE(extent[2], frame.distance);
    CHECK(least_shown(model, frame, 64, 64, 0.6) > 0.995);
    SceneFrame nearer = frame;  // a nearer camera must not show the whole model
    nearer.distance *= 0.85;
    CHECK(least_shown(model, nearer, 64, 64, 0.6) < 0.99);
  }
}

// In an earlier version, the orbit was so close that feet and corners of these models were outside the image:
// the images contained 99.2, 99.0 and 98.9 % of the opacity.
TEST_CASE("scene frame: models of other tools are inside the image from all sides") {
  UBS_REQUIRE_DATA(folder, "foreign_splats");
  for (const char* name : {"biker.spz", "opensplat_lego_world.ply", "graphdeco_sh3_9080.ply"}) {
    const MixedModel model = load_splat_model(folder / name).model;
    const double fov = 0.7;
    const SceneFrame frame = scene_frame(model, {}, {.up_without_floor = {0, -1, 0}, .fov = fov});
    INFO(name);
    CHECK(least_shown(model.groups.front(), frame, 600, 600, fov) > 0.995);
    SceneFrame nearer = frame;
    nearer.distance *= 0.8;
    CHECK(least_shown(model.groups.front(), nearer, 600, 600, fov) < 0.99);
  }
}

// Returns a box with a size of 2 x 1 x 3. If `plate` is true, a third of the splats form a plate at one end
// of the axis, the lower end if `sign` is 1.
SplatModel box_with_plate(std::size_t axis, int sign, bool plate) {
  SplatModel model(3, 3000);
  Random random(5);
  const std::array<double, 3> half{1, 0.5, 1.5};
  for (std::size_t i = 0; i < model.count; ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      double t = random.uniform(-1, 1);
      if (plate && k == axis && i % 3 == 0) t = sign * (-1 + 0.01 * t);
      model.row(static_cast<int>(k))[i] = static_cast<float>(half[k] * t);
    }
  return model;
}

TEST_CASE("scene frame: without cameras, a floor determines the up direction") {
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const int sign : {1, -1}) {
      Vec3 expected{};
      expected[axis] = sign;
      CHECK(scene_frame(MixedModel(box_with_plate(axis, sign, true)), {}).up == expected);
    }
  const MixedModel box(box_with_plate(0, 1, false));
  CHECK(scene_frame(box, {}, {.up_without_floor = {0, -1, 0}}).up == Vec3{0, -1, 0});
  CHECK(scene_frame(box, {}, {.up = Vec3{1, 0, 0}}).up == Vec3{1, 0, 0});
}

TEST_CASE("scene frame: for cameras side by side, the focus of the spiral is the scene") {
  SplatModel model(3, 500);
  Random random(4);
  for (std::size_t i = 0; i < model.count; ++i) {
    model.row(0)[i] = static_cast<float>(random.uniform(-1, 1));
    model.row(1)[i] = static_cast<float>(random.uniform(-1, 1));
    model.row(2)[i] = static_cast<float>(random.uniform(5.5, 6.5));
  }
  std::vector<Camera> cameras;
  for (const double x : {-0.3, -0.1, 0.1, 0.3})
    cameras.push_back(camera_at(look_at({x, 0.1, 0}, {x, 0.1, 1}, {0, -1, 0}), {}));
  const SceneFrame frame = scene_frame(MixedModel(model), cameras);
  CHECK(distance(frame.up, {0, -1, 0}) < 1e-12);
  CHECK(distance(frame.mean.position, {0, 0.1, 0}) < 1e-12);
  CHECK(frame.focus == Approx(6).margin(0.1));
  CHECK(frame.spread == Approx(0.3));
  CHECK(distance(frame.centre, {0, 0, 6}) < 0.2);  // parallel views do not intersect, so the splats are used
}
