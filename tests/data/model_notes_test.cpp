// SPDX-License-Identifier: Apache-2.0
// Tests the comments of a model file about render settings and cameras.
#include "host/formats/model_notes.hpp"

#include <catch2/catch.hpp>

#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "host/scene/initialise.hpp"
#include "host/scene/pose.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

using test::message_of;

std::vector<Camera> ring(int count) {
  std::vector<Camera> cameras;
  for (int i = 0; i < count; ++i) {
    const double angle = 0.1 + 6.28 * i / count;
    Camera camera = camera_at(look_at({4 * std::cos(angle), 4 * std::sin(angle), 1}, {0, 0, 0}, {0, 0, 1}),
                              {.width = 64, .height = 48, .extra = {}});
    camera.time = 0.25;
    cameras.push_back(camera);
  }
  return cameras;
}

TEST_CASE("model notes: notes are written and read back, and other comments are kept", "[ply]") {
  const std::vector<Camera> cameras = ring(30);
  const ModelNotes notes = make_notes({{"background", "1,0.5,0"}, {"alpha_min", "0"}}, cameras);
  REQUIRE(notes.cameras.size() == kNotedCameras);
  const test::TempFolder folder;
  std::vector<std::string> comments = comments_of(notes);
  CHECK(comments.size() == 2 + kNotedCameras);
  comments.insert(comments.begin(), "made by a test");
  write_splat_ply(folder / "m.ply", initialise_random(6, 20, 1), comments);
  const LoadedModel loaded = load_splat_model(folder / "m.ply");
  CHECK(loaded.comments == comments);
  CHECK(loaded.notes.drawing == notes.drawing);
  REQUIRE(loaded.notes.cameras.size() == kNotedCameras);
  for (std::size_t i = 0; i < kNotedCameras; ++i) {
    const Camera &in = cameras[i * 30 / kNotedCameras], &out = loaded.notes.cameras[i];
    // The comments store numbers with seven digits.
    for (std::size_t k = 0; k < 9; ++k) CHECK(out.rotation[k] == Approx(in.rotation[k]).margin(1e-6));
    for (std::size_t k = 0; k < 3; ++k) CHECK(out.centre()[k] == Approx(in.centre()[k]).margin(4e-6));
    CHECK(out.fx == Approx(in.fx).epsilon(1e-6));
    CHECK(out.width == 64);
    CHECK(out.height == 48);
    CHECK(out.time == 0.25);
  }
}

TEST_CASE("model notes: invalid notes are rejected", "[ply]") {
  const auto refused = [](const std::vector<std::string>& comments) {
    return message_of([&] { notes_of(comments, "m.ply"); });
  };
  const std::string lens = "ubs_lens 64 48 50 50";
  CHECK(notes_of(std::vector{lens, std::string("ubs_camera 1 0 0 0 1 2 3 0")}, "m.ply").cameras.size() == 1);
  for (const char* camera :
       {"ubs_camera 1 0 0 0 1 2 3", "ubs_camera 1 0 0 0 1 2 nan 0", "ubs_camera 1 0 0 0 1 2 3 x",
        "ubs_camera 0 0 0 0 1 2 3 0", "ubs_camera 1 0 0 0 1 2 1e300 0"}) {
    INFO(camera);
    CHECK_THAT(refused({lens, camera}), Catch::StartsWith("m.ply: comment 'ubs_camera"));
  }
  CHECK_THAT(refused({"ubs_camera 1 0 0 0 1 2 3 0"}), Catch::Contains("ubs_lens"));
  CHECK_THAT(refused({"ubs_lens 64.5 48 50 50"}), Catch::Contains("64.5 pixels"));
  CHECK(notes_of(comments_of({.up = Vec3{0, -1, 0}}), "m.ply").up == Vec3{0, -1, 0});
  CHECK_THAT(refused({"ubs_up 0 0 0"}), Catch::Contains("no direction"));
  CHECK_THAT(refused({"ubs_drawn background"}), Catch::Contains("key=value"));
  // A note of a later version may contain unknown keys, which are ignored.
  CHECK(notes_of(std::vector<std::string>{"ubs_drawn exposure=2 eps2d=0.1"}, "m.ply").drawing.size() == 1);
}

}  // namespace
}  // namespace ubs
