// SPDX-License-Identifier: Apache-2.0
// Tests that the loaders of all layouts, and the reader of camera paths, reject invalid values of cameras and
// points with a message that describes the value. The limits are in host/scene/camera.hpp.
#include <nlohmann/json.hpp>

#include "host/base/crc32.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/npy.hpp"
#include "host/dataset/packed.hpp"
#include "host/model/keyframes.hpp"
#include "tests/support/images.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
using nlohmann::json;

namespace {

json frame(double time = 0) {
  return {{"file_path", "a"},
          {"time", time},
          {"transform_matrix", {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 4}, {0, 0, 0, 1}}}};
}

json document() {
  return {{"w", 16},
          {"h", 12},
          {"fl_x", 20},
          {"fl_y", 20},
          {"cx", 8},
          {"cy", 6},
          {"frames", {frame(0), frame(1)}}};
}

// Checks that both layouts of JSON files are rejected with a message that contains `what`.
void check_refused(const TempFolder& folder, const json& text, const std::string& what) {
  for (const char* layout : {"blender", "nerfstudio"}) {
    INFO(layout << " " << text.dump());
    put(folder / "transforms.json", text.dump());
    put(folder / "transforms_train.json", text.dump());
    CHECK_THAT(
        message_of([&] { load_dataset(folder.path(), {.read = {.layout = layout}, .load_images = false}); }),
        Contains("transforms") && Contains(what));
  }
}

void put_colmap(const TempFolder& folder, const std::string& camera, const std::string& pose,
                const std::string& point) {
  put(folder / "sparse/0/cameras.txt", "1 PINHOLE 16 12 " + camera + "\n");
  put(folder / "sparse/0/images.txt", "1 " + pose + " 1 a.png\n\n");
  put(folder / "sparse/0/points3D.txt", "1 " + point + " 1 2 3 0.1\n");
}

std::string colmap_refusal(const TempFolder& folder) {
  return message_of(
      [&] { load_dataset(folder.path(), {.read = {.layout = "colmap"}, .load_images = false}); });
}

View simple_view() {
  View view{"a", {}, {2, 1, std::vector<std::uint8_t>(6, 9), {}}, nullptr};
  view.camera.width = 2, view.camera.height = 1;
  return view;
}

// Replaces text in the header of a packed file and corrects its length and checksum.
void rewrite_header(const std::filesystem::path& path, const std::string& from, const std::string& to) {
  const std::string file = get(path);
  std::uint64_t length = 0;
  std::memcpy(&length, file.data() + 16, sizeof length);
  std::string header = file.substr(24, length);
  const std::size_t at = header.find(from);
  INFO(header);
  REQUIRE(at != std::string::npos);
  header.replace(at, from.size(), to);
  const std::uint64_t size = header.size();
  const std::uint32_t crc = crc32(std::as_bytes(std::span(header)));
  std::string head = file.substr(0, 24);
  std::memcpy(head.data() + 12, &crc, sizeof crc);
  std::memcpy(head.data() + 16, &size, sizeof size);
  put(path, head + header + file.substr(24 + length));
}

}  // namespace

TEST_CASE("values: invalid values in JSON files are rejected", "[values]") {
  const TempFolder folder;
  check_refused(
      folder,
      [] {
        json j = document();
        j["frames"][1]["time"] = 1e308;
        return j;
      }(),
      "frame 1: 'time' = 1e+308");
  check_refused(
      folder,
      [] {
        json j = document();
        j["frames"][0]["time"] = -1e308;
        return j;
      }(),
      "frame 0: 'time'");
  for (const char* key : {"fl_x", "fl_y", "cx", "cy"})
    check_refused(
        folder,
        [&] {
          json j = document();
          j[key] = 1e308;
          return j;
        }(),
        fmt::format("'{}' = 1e+308", key));
  check_refused(
      folder,
      [] {
        json j = document();
        j["fl_x"] = 1e-300;
        return j;
      }(),
      "frame 0: the focal length");
  check_refused(
      folder,
      [] {
        json j = document();
        j["frames"][1]["transform_matrix"][0][3] = -1e30;
        return j;
      }(),
      "frame 1: 'transform_matrix' = -1e+30");
  check_refused(
      folder,
      [] {
        json j = document();
        j["frames"][1]["transform_matrix"][0][0] = -1;
        return j;
      }(),
      "frame 1: 'transform_matrix' is not a rotation (determinant -1");
  check_refused(
      folder,
      [] {
        json j = document();
        j["frames"][1]["transform_matrix"] = {{0, 0, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 1}};
        return j;
      }(),
      "is not a rotation");
}

TEST_CASE("values: times of any range are mapped to 0 to 1", "[values]") {
  const TempFolder folder;
  json text = document();
  text["frames"][0]["time"] = -1e15, text["frames"][1]["time"] = 1e15;
  put(folder / "transforms_train.json", text.dump());
  const Dataset data = load_dataset(folder.path(), {.load_images = false});
  CHECK(data.splits[0].views[0].camera.time == 0);
  CHECK(data.splits[0].views[1].camera.time == 1);
}

TEST_CASE("values: invalid values in COLMAP files are rejected", "[values]") {
  const TempFolder folder;
  const char *camera = "20 20 8 6", *pose = "1 0 0 0 0 0 4", *point = "0 0 0";
  put_colmap(folder, camera, pose, point);
  CHECK(colmap_refusal(folder).empty());
  put_colmap(folder, "1e308 20 8 6", pose, point);
  CHECK_THAT(colmap_refusal(folder), Contains("image 'a.png': the focal length = 1e+308"));
  put_colmap(folder, "20 20 -1e308 6", pose, point);
  CHECK_THAT(colmap_refusal(folder), Contains("the principal point"));
  put_colmap(folder, camera, "1 0 0 0 1e200 0 4", point);
  CHECK_THAT(colmap_refusal(folder), Contains("image 'a.png': the position"));
  put_colmap(folder, camera, pose, "1e39 0 0");
  CHECK_THAT(colmap_refusal(folder), Contains("points3D.txt:1: point 0 = 1e+39"));
}

TEST_CASE("values: invalid values in LLFF poses are rejected", "[values]") {
  const TempFolder folder;
  put_image(folder / "images/a.png", 16, 12);
  const std::vector<float> good{0, 1, 0, 0, 12, -1, 0, 0, 0, 16, 0, 0, 1, 0, 20, 2, 9};
  const auto refusal = [&](std::size_t at, float value) {
    std::vector<float> row = good;
    row[at] = value;
    write_npy(folder / "poses_bounds.npy", std::vector<std::size_t>{1, 17}, row);
    return message_of([&] { load_dataset(folder.path(), {.read = {.test_every = 0}}); });
  };
  CHECK(refusal(0, 0).empty());
  CHECK_THAT(refusal(1, -1), Contains("row 0: the pose is not a rotation (determinant -1"));  // mirrored
  CHECK_THAT(refusal(1, 0), Contains("row 0: the pose is not a rotation"));
  CHECK_THAT(refusal(14, 1e30f), Contains("row 0: value 14 = 1e+30"));
  CHECK_THAT(refusal(14, -1e38f), Contains("row 0: value 14"));
}

TEST_CASE("values: packed data sets are checked when written and when read", "[values]") {
  const TempFolder folder;
  const auto written = [&](const auto& change) {
    PackedData data{.splits = {{"train", {simple_view()}}}};
    change(data);
    return message_of([&] { write_packed(folder / "x.ubsd", data); });
  };
  CHECK(written([](PackedData&) {}).empty());
  const auto camera = [](const auto& change) {
    return [=](PackedData& data) { change(data.splits[0].views[0].camera); };
  };
  CHECK_THAT(written(camera([](Camera& c) { c.rotation = {}; })),
             Contains("view 'a'") && Contains("not a rotation"));
  CHECK_THAT(written(camera([](Camera& c) { c.fx = std::nan(""); })), Contains("focal length is not finite"));
  CHECK_THAT(written(camera([](Camera& c) { c.cx = 1e308; })), Contains("principal point = 1e+308"));
  CHECK_THAT(written(camera([](Camera& c) { c.time = INFINITY; })), Contains("the time is not finite"));

  // Simulates manipulated files: the checksum of the header is correct.
  PackedData data{.splits = {{"train", {simple_view()}}}, .points = PointCloud{{{1, 2, 3}}, {{4, 5, 6}}}};
  const auto read = [&](const std::string& from, const std::string& to) {
    std::filesystem::remove(folder / "x.ubsd");  // ubs does not replace files that were changed afterwards
    write_packed(folder / "x.ubsd", data);
    rewrite_header(folder / "x.ubsd", from, to);
    return message_of([&] { load_dataset(folder / "x.ubsd"); });
  };
  CHECK(read("\"time\":0.0", "\"time\":1.0").empty());
  CHECK_THAT(read("[1.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0]", "[0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0]"),
             Contains("view 'a'") && Contains("not a rotation"));
  CHECK_THAT(read("[1.0,0.0,0.0,0.0,1.0,", "[-1.0,0.0,0.0,0.0,1.0,"), Contains("determinant -1"));
  CHECK_THAT(read("\"time\":0.0", "\"time\":1e308"), Contains("the time = 1e+308"));
  CHECK_THAT(read("\"depth_bounds\":[]", "\"depth_bounds\":[[1,2],[1,2]]"), Contains("2 depth bounds"));
  CHECK_THAT(read("\"offset\":[0.0,0.0,0.0]", "\"offset\":[1e300,0,0]"), Contains("the offset"));
  data.points->positions[0][1] = NAN;
  CHECK_THAT(read("\"time\":0.0", "\"time\":0.5"), Contains("point 0 is not finite"));
}

TEST_CASE("values: bytes after the end of a packed data set are rejected", "[values]") {
  const TempFolder folder;
  write_packed(folder / "x.ubsd", {.splits = {{"train", {simple_view()}}}});
  const std::string whole = get(folder / "x.ubsd");
  put(folder / "x.ubsd", whole + "more");
  CHECK_THAT(message_of([&] { load_dataset(folder / "x.ubsd"); }),
             Contains("the header describes blocks of 6 bytes, but 10 bytes follow it"));
}

TEST_CASE("values: invalid values in keyframes are rejected", "[values]") {
  const TempFolder folder;
  const auto refusal = [&](const std::string& keyframe) {
    put(folder / "k.json", R"({"keyframes": [)" + keyframe + "]}");
    return message_of([&] { read_keyframes(folder / "k.json", {}); });
  };
  CHECK(refusal(R"({"position": [0,0,4], "look_at": [0,0,0], "up": [0,1,0]})").empty());
  CHECK_THAT(refusal(R"({"position": [0,0,1e300], "look_at": [0,0,0]})"),
             Contains("keyframe 0: 'position' = 1e+300"));
  CHECK_THAT(refusal(R"({"position": [0,0,4], "look_at": [0,0,0], "up": [0,1,0], "time": 1e200})"),
             Contains("keyframe 0: 'time'"));
  CHECK_THAT(refusal(R"({"world_to_camera": [[-1,0,0,0],[0,1,0,0],[0,0,1,0]]})"), Contains("determinant -1"));
}

TEST_CASE("values: cameras have at most 65535 pixels per side and 2^29 in total", "[values]") {
  const auto message = [](int width, int height) {
    Camera camera{.fx = 8, .fy = 8, .cx = 4, .cy = 4};
    camera.width = width, camera.height = height;
    return message_of([&] { check_camera(camera, "a"); });
  };
  CHECK(message(65535, 8192).empty());
  CHECK(message(8192, 65535).empty());
  for (const auto& [width, height] : {std::pair{65536, 1}, {1, 65536}, {65535, 8193}, {32768, 16385}, {0, 8}})
    CHECK_FALSE(message(width, height).empty());
}
