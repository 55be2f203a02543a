// SPDX-License-Identifier: Apache-2.0
// Tests reading files with keyframes of a camera path: valid files, and error messages for invalid files.
#include "host/model/keyframes.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>

#include "tests/support/temp_folder.hpp"
#include "tests/view/distance.hpp"

using namespace ubs;
using Catch::Contains;
using test::distance;
using test::TempFolder;

namespace {

std::string refused(const std::string& text) {
  const TempFolder folder;
  test::put(folder / "k.json", text);
  return test::message_of([&] { read_keyframes(folder / "k.json", {}); });
}

std::string refused_frame(const std::string& frame) {
  return refused(R"({"keyframes": [{"position": [0,0,0], "look_at": [0,0,1], "up": [0,-1,0]}, )" + frame +
                 "]}");
}

}  // namespace

TEST_CASE("keyframes: the three representations of a pose agree") {
  const TempFolder folder;
  // All keyframes are at (1, 2, 3) and look along +x with z up. The axes of the camera in "transform_matrix"
  // are those of transforms.json: x right, y up, z back.
  test::put(folder / "k.json", R"({"closed": true, "keyframes": [
    {"position": [1, 2, 3], "look_at": [5, 2, 3], "up": [0, 0, 1], "fov": 40},
    {"world_to_camera": [[0,-1,0,2],[0,0,-1,3],[1,0,0,-1]], "fov": 60},
    {"transform_matrix": [[0,0,-1,1],[-1,0,0,2],[0,1,0,3],[0,0,0,1]]}]})");
  const KeyframeFile file = read_keyframes(folder / "k.json", {.fov = 0.5, .offset = {1, 1, 1}});
  REQUIRE(file.poses.size() == 3);
  CHECK(file.closed);
  CHECK(!file.has_time);
  for (const Pose& pose : file.poses) {
    CHECK(distance(pose.position, {0, 1, 2}) < 1e-14);
    CHECK(distance(pose.forward(), {1, 0, 0}) < 1e-14);
    CHECK(distance(pose.down(), {0, 0, -1}) < 1e-14);
  }
  CHECK(file.poses[0].fov == Approx(40 * std::numbers::pi / 180));
  CHECK(file.poses[1].fov == Approx(60 * std::numbers::pi / 180));
  CHECK(file.poses[2].fov == 0.5);
}

TEST_CASE("keyframes: paths of other programs are read") {
  const TempFolder folder;
  const auto read = [&](const std::string& text) {
    test::put(folder / "k.json", text);
    return read_keyframes(folder / "k.json", {});
  };
  // All cameras are at (1, 2, 3), look along +x, and have z up.
  const KeyframeFile nerfstudio = read(R"({"camera_type": "perspective", "render_width": 1600,
    "render_height": 800, "is_cycle": true, "keyframes": [{"matrix": "[]"}], "camera_path": [
    {"camera_to_world": [0,0,-1,1, -1,0,0,2, 0,1,0,3, 0,0,0,1], "fov": 90, "aspect": 1}]})");
  const KeyframeFile gaussians = read(R"([{"id": 0, "img_name": "a", "width": 200, "height": 100,
    "position": [1,2,3], "rotation": [[0,0,1],[-1,0,0],[0,-1,0]], "fx": 100, "fy": 50}])");
  // SuperSplat rotates the model by 180 degrees about z.
  const KeyframeFile supersplat = read(R"({"camera": {"fov": 75}, "animTracks": [{"loopMode": "none",
    "keyframes": {"times": [0], "values": {"position": [-1,-2,3], "target": [-5,-2,3]}}}]})");
  CHECK(nerfstudio.closed);
  for (const KeyframeFile& file : {nerfstudio, gaussians, supersplat}) {
    REQUIRE(file.poses.size() == 1);
    CHECK(distance(file.poses[0].position, {1, 2, 3}) < 1e-14);
    CHECK(distance(file.poses[0].forward(), {1, 0, 0}) < 1e-14);
  }
  for (const KeyframeFile& file : {nerfstudio, gaussians})
    CHECK(distance(file.poses[0].down(), {0, 0, -1}) < 1e-14);
  CHECK(distance(supersplat.poses[0].down(), {0, 1, 0}) < 1e-14);
  CHECK(nerfstudio.poses[0].fov == Approx(2 * std::atan(2.0)));  // 90 degrees high, twice as wide as high
  CHECK(gaussians.poses[0].fov == Approx(std::numbers::pi / 2));
  CHECK(supersplat.poses[0].fov == Approx(75 * std::numbers::pi / 180));
  CHECK_THAT(refused(R"({"camera_path": [{"camera_to_world": [1, 2]}]})"),
             Contains("camera 0: 'camera_to_world' must be 16 numbers"));
  CHECK_THAT(refused(R"({"camera_type": "fisheye", "camera_path": []})"), Contains("perspective"));
  CHECK_THAT(refused(R"([{"position": [1,2,3]}])"), Contains("camera 0: 'rotation' is missing"));
  CHECK_THAT(refused(R"({"animTracks": [{"keyframes": {"times": [0, 1], "values": {"position": [1]}}}]})"),
             Contains("'position' must be 6 numbers"));
}

TEST_CASE("keyframes: errors contain the file, the keyframe and the field") {
  CHECK_THAT(refused("{"), Contains("k.json") && Contains("malformed JSON"));
  CHECK_THAT(refused("[]"), Contains("top level"));
  CHECK_THAT(refused("{}"), Contains("'keyframes' is missing"));
  CHECK_THAT(refused(R"({"keyframes": []})"), Contains("'keyframes' must be a non-empty array"));
  CHECK_THAT(refused(R"({"keyframes": [3]})"), Contains("keyframe 0: must be an object"));
  CHECK_THAT(
      refused(R"({"keyframes": [{"position": [0,0,0], "look_at": [0,0,1], "up": [0,1,0]}], "loop": 1})"),
      Contains("unknown field 'loop'"));
  CHECK_THAT(refused(R"({"closed": 1, "keyframes": [{}]})"), Contains("'closed' must be true or false"));
  const auto frame = [](const std::string& text, const std::string& reason) {
    INFO(text);
    CHECK_THAT(refused_frame(text), Contains("k.json: keyframe 1: ") && Contains(reason));
  };
  frame("{}", "exactly one of 'position'");
  frame(R"({"position": [0,0,0]})", "'look_at' is missing");
  frame(R"({"position": [0,0], "look_at": [0,0,1]})", "'position' must be three finite numbers");
  frame(R"({"position": [0,0,"1"], "look_at": [0,0,1]})", "'position' must be three finite numbers");
  frame(R"({"position": [0,0,0], "look_at": [0,0,0]})", "'look_at' must differ from the position");
  frame(R"({"position": [0,0,0], "look_at": [0,0,1], "up": [0,0,2]})", "'up' must not be zero or parallel");
  frame(R"({"position": [0,0,0], "look_at": [0,0,1], "up": [0,1,0], "fov": 0})", "'fov' = 0");
  frame(R"({"position": [0,0,0], "look_at": [0,0,1], "up": [0,1,0], "fov": "wide"})",
        "'fov' must be a number");
  frame(R"({"position": [0,0,0], "look_at": [0,0,1], "up": [0,1,0], "lookat": 1})", "unknown field 'lookat'");
  frame(R"({"world_to_camera": [[1,0,0,0],[0,1,0,0],[0,0,2,0]]})", "'world_to_camera' is not a rotation");
  frame(R"({"world_to_camera": [[1,0,0,0],[0,1,0,0]]})", "'world_to_camera' must be 4x4 (or 3x4)");
  frame(R"({"world_to_camera": [[1,0,0,0],[0,1,0,0],[0,0,1,0]], "up": [0,1,0]})", "'up' requires 'position'");
  CHECK_THAT(refused_frame(R"({"position": [0,0,0], "look_at": [0,0,1], "up": [0,1,0], "time": 1})"),
             Contains("1 of 2 keyframes have a 'time'"));
}
