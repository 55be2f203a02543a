// SPDX-License-Identifier: Apache-2.0
// The viewer without its window: what events do to camera and choices.
#include "host/view/viewer.hpp"

#include <catch2/catch.hpp>

#include "host/view/window.hpp"
#include "tests/view/distance.hpp"

using namespace ubs;
using test::distance;

namespace {

constexpr double kClose = 1e-12;

ViewerScene scene(int views = 3) {
  ViewerScene s;
  s.frame.centre = {1, 2, 3};
  s.frame.up = normalised({0, -1, 0.1});
  s.frame.start = perpendicular(s.frame.up);
  s.frame.distance = 5;
  s.frame.elevation = 0.3;
  for (int i = 0; i < views; ++i) {
    Camera camera = camera_at(look_at({4.0 + i, 0, 0}, s.frame.centre, s.frame.up), {400, 300, {}});
    camera.time = 0.25 * i;
    camera.extra = {0.1 * i};
    s.views.push_back(camera);
  }
  s.has_time = true;
  s.has_beta = {true, true, true};
  return s;
}

Viewer free_viewer() { return Viewer(scene(0), 400, 300); }

// Where a point of the world is in the picture [px].
std::array<double, 2> seen(const Viewer& viewer, const Vec3& point) {
  const Camera c = viewer.camera();
  const Vec3 d = point - viewer.pose().position;
  const double z = dot(d, viewer.pose().forward());
  return {c.fx * dot(d, viewer.pose().right()) / z + c.cx, c.fy * dot(d, viewer.pose().down()) / z + c.cy};
}

}  // namespace

TEST_CASE("viewer: begins where it looks at the scene, and comes back there") {
  Viewer viewer = free_viewer();
  CHECK(distance(viewer.pose().position, viewer.scene().frame.centre) == Approx(5));
  CHECK(seen(viewer, {1, 2, 3})[0] == Approx(200));
  CHECK(seen(viewer, {1, 2, 3})[1] == Approx(150));
  const Vec3 home = viewer.pose().position;
  viewer.key('w');
  viewer.wheel(2);
  viewer.key('d');
  CHECK(distance(viewer.pose().position, home) > 0.5);
  viewer.key('r');
  CHECK(distance(viewer.pose().position, home) < kClose);
}

TEST_CASE("viewer: dragging turns around the scene, keeps the horizon and stops at the poles") {
  Viewer viewer = free_viewer();
  const Vec3 centre = viewer.scene().frame.centre, up = viewer.scene().frame.up;
  viewer.move(50, 50);  // no button: nothing
  CHECK(viewer.changes() == free_viewer().changes());
  viewer.press(Drag::orbit, 100, 100);
  const Vec3 before = viewer.pose().position;
  viewer.move(200, 100);  // a quarter of the width: 45 degrees
  const Vec3 after = viewer.pose().position;
  const auto level = [&](const Vec3& p) { return p - centre - dot(p - centre, up) * up; };
  CHECK(std::acos(dot(normalised(level(before)), normalised(level(after)))) == Approx(3.14159265 / 4));
  CHECK(dot(before - centre, up) == Approx(dot(after - centre, up)));
  for (int i = 0; i < 50; ++i) viewer.move(200 + i, 100 + 40 * i);
  CHECK(distance(viewer.pose().position, centre) == Approx(5));
  CHECK(std::abs(dot(viewer.pose().right(), up)) < 1e-9);
  CHECK(dot(viewer.pose().down(), up) < 0);  // never upside down
  CHECK(seen(viewer, centre)[0] == Approx(200));
  viewer.release();
  const auto changes = viewer.changes();
  viewer.move(0, 0);
  CHECK(viewer.changes() == changes);
}

TEST_CASE("viewer: shifting keeps the scene under the mouse, the wheel and + go nearer") {
  Viewer viewer = free_viewer();
  const Vec3 point = viewer.scene().frame.centre;
  viewer.press(Drag::pan, 200, 150);
  viewer.move(230, 140);
  CHECK(seen(viewer, point)[0] == Approx(230));
  CHECK(seen(viewer, point)[1] == Approx(140));
  CHECK(distance(viewer.pose().forward(), free_viewer().pose().forward()) < kClose);

  viewer = free_viewer();
  viewer.wheel(1);
  CHECK(distance(viewer.pose().position, point) == Approx(4.5));
  viewer.key('-');
  CHECK(distance(viewer.pose().position, point) == Approx(5));
  for (int i = 0; i < 1000; ++i) viewer.wheel(10);
  CHECK(distance(viewer.pose().position, point) > 1e-3);  // never through the scene
  viewer = free_viewer();
  viewer.press(Drag::dolly, 0, 0);
  viewer.move(0, 30);
  CHECK(distance(viewer.pose().position, point) > 5.5);
}

TEST_CASE("viewer: keys fly along the camera's axes") {
  for (const auto& [keys, axis] : {std::pair{"ws", 2}, {"da", 0}, {"qe", 1}}) {
    Viewer viewer = free_viewer();
    const Pose start = viewer.pose();
    const Vec3 way = axis == 2 ? start.forward() : axis == 0 ? start.right() : start.down();
    viewer.key(keys[0]);
    CHECK(distance(viewer.pose().position, start.position + 0.25 * way) < kClose);
    viewer.key(keys[1]);
    CHECK(distance(viewer.pose().position, start.position) < kClose);
  }
  Viewer viewer = free_viewer();
  const auto changes = viewer.changes();
  for (const char key : {'x', '7', '\t'}) viewer.key(key);
  CHECK(viewer.changes() == changes);
}

TEST_CASE("viewer: views of the data, shown whole, with their time") {
  Viewer viewer(scene(), 400, 200);  // wider than the views
  CHECK(distance(viewer.pose().position, {4, 0, 0}) < kClose);
  viewer.key('3');
  CHECK(distance(viewer.pose().position, {6, 0, 0}) < kClose);
  CHECK(viewer.pose().time == 0.5);
  const Camera shown = viewer.camera(), view = viewer.scene().views[2];
  CHECK(shown.extra == view.extra);
  CHECK(shown.height / shown.fy == Approx(view.height / view.fy));
  CHECK(shown.width / shown.fx > view.width / view.fx);
  viewer.key('4');  // there is none
  CHECK(distance(viewer.pose().position, {6, 0, 0}) < kClose);
}

TEST_CASE("viewer: modes, sliders, keyframes, orders") {
  Viewer viewer = free_viewer();
  viewer.key('m');
  CHECK(viewer.channel() == Channel::alpha);
  viewer.key('M');
  CHECK(viewer.channel() == Channel::depth);
  viewer.key('m');
  CHECK(viewer.channel() == Channel::rgb);

  const auto choices = viewer.choices();
  viewer.set_beta_low(BetaKind::angular, 0.6);
  CHECK(viewer.choices() == choices + 1);
  viewer.set_beta_high(BetaKind::angular, 0.2);  // takes the other end along
  CHECK(viewer.beta(BetaKind::angular).low == 0.2);
  CHECK(viewer.beta(BetaKind::angular).high == 0.2);
  viewer.set_beta_low(BetaKind::angular, 7);
  CHECK(viewer.beta(BetaKind::angular).high == 1);
  CHECK(viewer.beta(BetaKind::spatial).high == 1);
  CHECK(viewer.beta(BetaKind::spatial).low == 0);
  CHECK(viewer.choices() == choices + 3);
  viewer.set_beta_low(BetaKind::angular, 1);
  CHECK(viewer.choices() == choices + 3);

  viewer.set_time(0.9);
  viewer.key(' ');
  CHECK(viewer.playing());
  viewer.advance(1);  // a quarter of the range: from 0.9 around to 0.15
  CHECK(viewer.pose().time == Approx(0.15));
  viewer.key(' ');
  viewer.advance(1);
  CHECK(viewer.pose().time == Approx(0.15));
  viewer.set_time(-3);
  CHECK(viewer.pose().time == 0);

  viewer.key('k');
  viewer.key('w');
  viewer.key('K');
  viewer.key('p');
  REQUIRE(viewer.keyframes().size() == 2);
  CHECK(distance(viewer.keyframes()[0].position, viewer.keyframes()[1].position) == Approx(0.25));
  CHECK(viewer.take_orders() ==
        std::vector<Order>{Order::save_keyframes, Order::save_keyframes, Order::save_picture});
  CHECK(viewer.take_orders().empty());

  CHECK(!viewer.help());
  viewer.key('h');
  CHECK(viewer.help());
  viewer.key('o');
  CHECK(!viewer.overlay());
  CHECK(!viewer.finished());
  viewer.key(27);
  CHECK(viewer.finished());
  CHECK(viewer_help(viewer.scene()).size() > 10);

  const auto changes = viewer.changes();
  viewer.resize(400, 300);
  CHECK(viewer.changes() == changes);
  viewer.resize(640, 480);
  CHECK(viewer.changes() == changes + 1);
  CHECK(viewer.camera().width == 640);
}

TEST_CASE("window: Shift, arrows and function keys type nothing") {
  const int num_lock = 0x100000;
  for (const int code :
       {-1, 0xffe1, 0xffe3, 0xffe5, 0xffeb, 0xff51, 0xff52, 0xffc1, 0xffff, 0xffe1 | num_lock})
    CHECK(typed_key(code) == '\0');
  CHECK(typed_key('w') == 'w');
  CHECK(typed_key('W' | num_lock) == 'W');
  CHECK(typed_key(27) == 27);
  CHECK(typed_key(0xffab) == '+');  // of the keypad
  CHECK(typed_key(0xffad) == '-');
  CHECK(typed_key(0xffb1) == '1');
}

TEST_CASE("adaptive resolution finds the size that takes the time wanted") {
  // A device with 10 ms of overhead and 400 ms for the pixels of the full size.
  const auto seconds = [](double scale) { return 0.01 + 0.4 * scale * scale; };
  AdaptiveScale adaptive;
  for (int i = 0; i < 20; ++i) adaptive.measured(adaptive.scale(), seconds(adaptive.scale()));
  CHECK(seconds(adaptive.scale()) == Approx(0.05).epsilon(0.02));
  for (int i = 0; i < 20; ++i) adaptive.measured(adaptive.scale(), 1e-4);
  CHECK(adaptive.scale() == 1);
  for (int i = 0; i < 20; ++i) adaptive.measured(adaptive.scale(), 10);
  CHECK(adaptive.scale() == 1.0 / 16);
}

TEST_CASE("viewer: the photograph belongs to the view that the camera stands at") {
  Viewer viewer(scene(3), 400, 300);
  CHECK(viewer.truth() == -1);
  const auto before = viewer.changes();
  viewer.key('G');
  CHECK(viewer.changes() > before);
  CHECK(viewer.truth() == 0);
  viewer.key('n');
  CHECK(viewer.truth() == 1);
  viewer.key('3');
  CHECK(viewer.truth() == 2);
  viewer.key('N');
  CHECK(viewer.truth() == 0);
  viewer.wheel(1);  // elsewhere now
  CHECK(viewer.truth() == -1);
  viewer.key('r');
  CHECK(viewer.truth() == 0);
  viewer.key('g');
  CHECK(viewer.truth() == -1);
  Viewer none = free_viewer();
  for (const char key : {'g', 'n'}) none.key(key);
  CHECK(none.truth() == -1);
}
