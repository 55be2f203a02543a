// SPDX-License-Identifier: Apache-2.0
// Tests the loader of transforms_*.json: camera mathematics, intrinsics, time, names, missing images, errors,
// and two real data sets if they are available. The file also contains the test of scene_extent().
#include "host/dataset/blender.hpp"

#include <cmath>
#include <random>

#include "host/dataset/image.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/scene/extent.hpp"
#include "tests/support/data.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

constexpr const char* kIdentity = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";

std::string frame(const std::string& more, const std::string& matrix = kIdentity,
                  const std::string& path = "./train/r_0") {
  return R"({"file_path": ")" + path + R"(", "transform_matrix": )" + matrix +
         (more.empty() ? "" : ", " + more) + "}";
}

std::string document(const std::string& frames,
                     const std::string& head = R"("camera_angle_x": 1.0, "w": 8, "h": 6)") {
  return "{" + head + (head.empty() ? "" : ",\n") + "\"frames\": [" + frames + "]}";
}

Split load(const TempFolder& folder, const std::string& json, const DatasetOptions& options = {}) {
  put(folder / "transforms_train.json", json);
  return load_blender_split(folder.path(), "train", options);
}

std::array<double, 2> project(const Camera& c, const std::array<double, 3>& p) {
  std::array<double, 3> q = c.translation;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t k = 0; k < 3; ++k) q[r] += c.rotation[3 * r + k] * p[k];
  REQUIRE(q[2] > 0);
  return {c.fx * q[0] / q[2] + c.cx, c.fy * q[1] / q[2] + c.cy};
}

}  // namespace

TEST_CASE("blender: a known point is projected to a known pixel", "[blender]") {
  TempFolder folder;
  // The camera is at (0, -4, 0), looks along +y, and has +z up: right = x, up = z, back = -y.
  const std::string matrix = "[[1,0,0,0],[0,0,-1,-4],[0,1,0,0],[0,0,0,1]]";
  const double angle = 2 * std::atan(0.5);  // gives fx = width, so one unit at depth 4 is width / 4 pixels
  const Split split =
      load(folder,
           document(frame("", matrix), fmt::format(R"("camera_angle_x": {:.17g}, "w": 80, "h": 60)", angle)));
  const Camera& camera = split.views.at(0).camera;
  CHECK(camera.fx == Approx(80).epsilon(1e-14));
  CHECK(camera.fy == camera.fx);
  const auto centre = camera.centre();
  CHECK(centre[0] == Approx(0).margin(1e-15));
  CHECK(centre[1] == Approx(-4));
  CHECK(centre[2] == Approx(0).margin(1e-15));
  const auto pixel = project(camera, {1, 0, 0.5});  // the point is right of and above the optical axis
  CHECK(pixel[0] == Approx(40 + 20));
  CHECK(pixel[1] == Approx(30 - 10));
}

TEST_CASE("blender: intrinsics are read from the file and from each frame", "[blender]") {
  TempFolder folder;
  const auto camera = [&](const std::string& head, const std::string& more, int downscale = 1) {
    DatasetOptions options;
    options.read.downscale = downscale;
    return load(folder, document(frame(more), head), options).views.at(0).camera;
  };
  const std::string pixels = R"("fl_x": 100, "fl_y": 110, "cx": 30, "cy": 20, "w": 64, "h": 48)";
  Camera c = camera(pixels, "");
  CHECK(std::array{c.fx, c.fy, c.cx, c.cy} == std::array{100.0, 110.0, 30.0, 20.0});
  c = camera(pixels, "", 2);
  CHECK(std::array{c.fx, c.fy, c.cx, c.cy} == std::array{50.0, 55.0, 15.0, 10.0});
  CHECK(std::array{c.width, c.height} == std::array{32, 24});
  c = camera(pixels, R"("fl_x": 90, "cx": 31)");  // the frame takes precedence
  CHECK(std::array{c.fx, c.fy, c.cx, c.cy} == std::array{90.0, 110.0, 31.0, 20.0});
  c = camera(R"("fl_x": 100, "w": 64, "h": 48)", "");
  CHECK(std::array{c.fx, c.fy, c.cx, c.cy} == std::array{100.0, 100.0, 32.0, 24.0});
  c = camera(R"("camera_angle_x": 1.0, "camera_angle_y": 0.5, "w": 64, "h": 48)", "");
  CHECK(c.fx == Approx(32 / std::tan(0.5)));
  CHECK(c.fy == Approx(24 / std::tan(0.25)));
  // Blender's add-ons write the angles of a sensor of 36 x 24 mm, independently of the image.
  c = camera(R"("camera_angle_x": 0.69, "camera_angle_y": 0.47, "fl_x": 89, "fl_y": 89, "w": 64, "h": 64)",
             "");
  CHECK(std::array{c.fx, c.fy} == std::array{89.0, 89.0});
  c = camera(R"("fl_x": 89, "w": 64, "h": 64)", R"("camera_angle_x": 1.0)");  // the frame takes precedence
  CHECK(c.fx == Approx(32 / std::tan(0.5)));
}

TEST_CASE("blender: pixel quantities are scaled to the size of the image file", "[blender]") {
  TempFolder folder;
  std::filesystem::create_directories(folder / "train");
  save_png_rgba(folder / "train/r_0.png", std::vector<std::uint8_t>(4 * 32 * 24, 200), 32, 24);
  const std::string json =
      document(frame(""), R"("fl_x": 100, "fl_y": 110, "cx": 30, "cy": 20, "w": 64, "h": 48)");
  const View view = load(folder, json).views.at(0);
  CHECK(view.image.width == 32);
  CHECK(view.image.rgb[0] == 156);  // 200 * 200 / 255 = 156.9, truncated
  const Camera& c = view.camera;
  CHECK(std::array{c.width, c.height} == std::array{32, 24});
  CHECK(std::array{c.fx, c.fy, c.cx, c.cy} == std::array{50.0, 55.0, 15.0, 10.0});
  DatasetOptions options;
  options.background = {1, 1, 1};
  options.read.downscale = 2;
  const View small = load(folder, json, options).views.at(0);
  CHECK(std::array{small.image.width, small.image.height} == std::array{16, 12});
  CHECK(small.image.rgb[0] == 211);  // 156.86 + 55 = 211.86, truncated
  CHECK(small.camera.fx == 25.0);
  options.load_images = false;
  const View bare = load(folder, document(frame(""), R"("camera_angle_x": 1.0)"), options).views.at(0);
  CHECK(bare.image.width == 0);
  CHECK(bare.camera.width == 16);  // read from the PNG header
  // The camera must be the same with and without pixels.
  const Camera same = load(folder, json, options).views.at(0).camera;
  CHECK(same.width == small.camera.width);
  CHECK(same.fx == small.camera.fx);
}

TEST_CASE("blender: a fractional size matches an image whose size differs by less than a pixel",
          "[blender]") {
  TempFolder folder;
  std::filesystem::create_directories(folder / "train");
  save_png_rgba(folder / "train/r_0.png", std::vector<std::uint8_t>(4 * 32 * 24, 200), 32, 24);
  // 40.5 % of 80 x 61 pixels: Blender renders 32 x 24 pixels, but the other values refer to the fractional
  // size.
  const std::string size = R"("w": 32.4, "h": 24.705)";
  const auto camera = [&](const std::string& head, const DatasetOptions& options = {}) {
    return load(folder, document(frame(""), head), options).views.at(0).camera;
  };
  const std::string pixels = R"("fl_x": 81, "fl_y": 81, "cx": 16.2, "cy": 12.3525, )" + size;
  for (const bool images : {true, false}) {
    const Camera c = camera(pixels, {.load_images = images});
    CHECK(std::array{c.width, c.height} == std::array{32, 24});
    CHECK(c.fx == Approx(81 * 32 / 32.4).epsilon(1e-14));
    CHECK(c.cx == Approx(16).epsilon(1e-14));
    CHECK(c.cy == Approx(12).epsilon(1e-14));
  }
  const Camera c = camera(R"("camera_angle_x": 1.0, )" + size);
  CHECK(c.fx == Approx(16 / std::tan(0.5)).epsilon(1e-14));
  CHECK(c.cx == Approx(16).epsilon(1e-14));
  CHECK(c.cy == Approx(12).epsilon(1e-14));
  CHECK_THAT(message_of([&] { camera(R"("camera_angle_x": 1.0, "w": 33.1, "h": 24)"); }),
             Contains("'w' = 33.1 must be a whole number"));
}

TEST_CASE("blender: time is normalised with the range of the training file", "[blender]") {
  TempFolder folder;
  const auto timed = [](const std::string& t) { return frame("\"time\": " + t); };
  put(folder / "transforms_test.json", document(timed("3") + "," + timed("7")));
  const Split train = load(folder, document(timed("2") + "," + timed("4") + "," + timed("6")));
  CHECK(train.views[0].camera.time == 0.0);
  CHECK(train.views[1].camera.time == 0.5);
  CHECK(train.views[2].camera.time == 1.0);
  const Split test = load_blender_split(folder.path(), "test");
  CHECK(test.name == "test");
  CHECK(test.views[0].camera.time == 0.25);
  CHECK(test.views[1].camera.time == 1.25);  // outside the training range: not clamped
  // A frame without time among frames with time is an error, also if it is in another file.
  CHECK_THAT(message_of([&] { load(folder, document(timed("2") + "," + frame(""))); }),
             Contains("transforms_train.json: frame 1: 'time' is missing"));
  CHECK_THAT(message_of([&] { load(folder, document(frame(""))); }),
             Contains("transforms_train.json: frame 0: 'time' is missing") &&
                 Contains("transforms_test.json: frame 0"));
  std::filesystem::remove(folder / "transforms_test.json");
  CHECK(load(folder, document(timed("5") + "," + timed("5"))).views[1].camera.time == 0.0);
  CHECK(load(folder, document(frame(""))).views[0].camera.time == 0.0);
}

TEST_CASE("blender: names become unique and lose their extensions, and query values are read", "[blender]") {
  TempFolder folder;
  const auto named = [](const std::string& path) { return frame("\"query\": [0.5, -1]", kIdentity, path); };
  const Split split =
      load(folder, document(named("a/r_0") + "," + named("b/r_0") + "," + named("r_0_2") + "," +
                            named("c/r_0.5") + "," + named("c/x.JPG") + "," + named("d/r_0")));
  std::vector<std::string> names;
  for (const View& view : split.views) names.push_back(view.name);
  CHECK(names == std::vector<std::string>{"r_0", "r_0_3", "r_0_2", "r_0.5", "x", "r_0_4"});
  CHECK(split.views[3].camera.extra == std::vector<double>{0.5, -1});
}

TEST_CASE("blender: a missing image is accepted if the JSON contains its size", "[blender]") {
  TempFolder folder;
  const View view = load(folder, document(frame(""))).views.at(0);
  CHECK(view.image.width == 0);
  CHECK(view.image.rgb.empty());
  CHECK(view.camera.width == 8);
  const std::string bare =
      document(frame("\"w\": 8, \"h\": 8") + "," + frame(""), R"("camera_angle_x": 1.0)");
  CHECK_THAT(message_of([&] { load(folder, bare); }),
             Contains("transforms_train.json: frame 1: image") && Contains("r_0 does not exist"));
  CHECK(load(folder, document(frame("", kIdentity, std::string(5000, 'n')))).views.at(0).image.width == 0);
  put(folder / "train/r_0.png", "damaged");
  CHECK_THAT(message_of([&] { load(folder, document(frame(""))); }), Contains("r_0.png: cannot decode"));
}

TEST_CASE("blender: errors contain the file, the frame and the field", "[blender]") {
  TempFolder folder;
  CHECK_THAT(message_of([&] { load_dataset(folder.path(), {.read = {.layout = "blender"}}); }),
             Contains("no transforms_train.json"));
  const auto refusal = [&](const std::string& json) { return message_of([&] { load(folder, json); }); };
  const auto bad_frame = [&](const std::string& second) {
    return refusal(document(frame("") + "," + second));
  };
  const auto bad_matrix = [&](const std::string& matrix) { return bad_frame(frame("", matrix)); };
  const std::string place = "transforms_train.json: frame 1: ";

  CHECK(refusal(document(frame(""))).empty());
  CHECK_FALSE(has_blender_split(folder.path(), "test"));
  CHECK_THAT(message_of([&] { load_blender_split(folder.path(), "test"); }),
             Contains("transforms_test.json: no such file"));
  CHECK_THAT(refusal("{\n \"frames\": [1,,2]}"), Contains("line 2") && Contains("column"));
  CHECK_THAT(refusal(""), Contains("malformed JSON"));
  CHECK_THAT(refusal("{\"camera_angle_x\": 1e999}"), Contains("malformed JSON"));
  CHECK_THAT(refusal("[1]"), Contains("must be an object"));
  CHECK_THAT(refusal("{}"), Contains("field 'frames' is missing"));
  CHECK_THAT(refusal("{\"frames\": []}"), Contains("non-empty array"));
  CHECK_THAT(refusal("{\"frames\": {}}"), Contains("non-empty array"));
  CHECK_THAT(bad_frame("7"), Contains(place + "must be an object"));
  CHECK_THAT(bad_frame("{}"), Contains(place + "'file_path' is missing"));
  CHECK_THAT(bad_frame(R"({"file_path": 3})"), Contains(place + "'file_path' must be"));
  CHECK_THAT(bad_frame(R"({"file_path": "a"})"), Contains(place + "'transform_matrix' is missing"));
  CHECK_THAT(bad_matrix("3"), Contains(place + "'transform_matrix' must be 4x4"));
  CHECK_THAT(bad_matrix("[[1,0,0,0],[0,1,0,0]]"), Contains("must be 4x4"));
  CHECK_THAT(bad_matrix("[[1,0,0],[0,1,0],[0,0,1],[0,0,0]]"), Contains("must be 4x4"));
  CHECK_THAT(bad_matrix("[[1,0,0,0],[0,1,0,0],[0,0,1,null]]"), Contains("must be 4x4"));
  CHECK_THAT(bad_matrix("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,2]]"), Contains("last row"));
  CHECK_THAT(bad_matrix("[[2,0,0,0],[0,2,0,0],[0,0,2,0]]"), Contains(place) && Contains("determinant 8"));
  CHECK_THAT(bad_matrix("[[-1,0,0,0],[0,1,0,0],[0,0,1,0]]"), Contains("determinant -1"));
  CHECK_THAT(bad_matrix("[[1,0.5,0,0],[0,1,0,0],[0,0,1,0]]"),
             Contains("not a rotation"));  // shear: determinant 1
  CHECK_THAT(bad_frame(frame("\"time\": \"x\"")), Contains(place + "'time' must be a number"));
  CHECK_THAT(bad_frame(frame("\"query\": 4")), Contains(place + "'query' must be an array"));
  CHECK_THAT(bad_frame(frame("\"query\": [null]")), Contains(place + "'query' must be an array of finite"));
  CHECK_THAT(bad_frame(frame("\"query\": [1]")),
             Contains(place + "'query' has 1 values, but 'query' of the first frame has 0"));
  CHECK_THAT(bad_frame(frame("\"w\": 8.5")), Contains(place + "'w' = 8.5 must be a whole number"));
  CHECK_THAT(bad_frame(frame("\"h\": 0")), Contains("'h' = 0"));
  CHECK_THAT(bad_frame(frame("\"h\": 1e12")), Contains("whole number"));
  CHECK_THAT(bad_frame(frame("\"fl_x\": -3")), Contains(place + "'fl_x' = -3 must be positive"));
  CHECK_THAT(bad_frame(frame("\"camera_angle_x\": 3.2")), Contains("between 0 and pi"));
  CHECK_THAT(bad_frame(frame("\"k1\": -0.2")), Contains(place + "'k1' = -0.2: lens distortion"));
  for (const auto& [more, what] :
       {std::pair{R"("is_fisheye": true)", "the camera model OPENCV_FISHEYE"},
        {R"("camera_model": "OPENCV_FISHEYE", "k1": 0)", "OPENCV_FISHEYE"},
        {R"("camera_model": "EQUIRECTANGULAR")", "the camera model EQUIRECTANGULAR"},
        {R"("camera_model": "FOV", "omega": 0.9)", "'omega' = 0.9"},
        {R"("camera_model": "FULL_OPENCV", "k6": 0.1)", "'k6' = 0.1"}})
    CHECK_THAT(bad_frame(frame(more)), Contains(place + "") && Contains(what) && Contains("lens distortion"));
  CHECK_THAT(bad_frame(frame("\"omega\": 0.9")), Contains("'omega' = 0.9 is not a coefficient"));
  CHECK_THAT(bad_frame(frame("\"latlong\": true")), Contains("'latlong' of instant-ngp is not supported"));
  CHECK(bad_frame(frame(R"("camera_model": "PINHOLE", "k1": 0, "is_fisheye": false)")).empty());
  CHECK(bad_frame(frame("\"k1\": 0.0, \"p2\": 0")).empty());
  CHECK_THAT(refusal(document(frame(""), "\"w\": 8, \"h\": 8")), Contains("'camera_angle_x' or 'fl_x'"));
}

namespace {

// Writes images of 8x6 pixels with different colours.
void put_pictures(const TempFolder& folder, const std::vector<std::string>& names) {
  std::uint8_t grey = 40;
  for (const std::string& name : names) {
    std::filesystem::create_directories((folder / name).parent_path());
    save_png(folder / name, {8, 6, std::vector<std::uint8_t>(8 * 6 * 3, grey += 20)});
  }
}

std::string notes_of(const Dataset& data) {
  std::string text;
  for (const std::string& note : data.report.notes) text += note + "\n";
  for (const LoadReport::Skipped& s : data.report.skipped)
    text += fmt::format("{} skipped: {} ({})\n", s.count, s.why, s.examples.at(0));
  return text;
}

std::string named(const std::string& path, const std::string& more = "") {
  return frame(more, kIdentity, path);
}

}  // namespace

TEST_CASE("blender: masks that frames name are used", "[blender]") {
  const TempFolder folder;
  put_pictures(folder, {"train/a.png", "test/a.png", "m/a.png"});
  save_png(folder / "m/a.png", {8, 6, std::vector<std::uint8_t>(8 * 6 * 3, 0)});
  for (const char* split : {"train", "test"})
    put(folder / fmt::format("transforms_{}.json", split),
        document(named(fmt::format("{}/a", split), R"("mask_path": "m/a.png")")));
  const Dataset data = load_dataset(folder.path());
  CHECK_THAT(notes_of(data), Contains("2 masks: masked pixels are ignored"));
  for (const Split& split : data.splits) {
    CHECK(split.views.at(0).masked);
    CHECK(split.views.at(0).image.mask == std::vector<std::uint8_t>(8 * 6, 0));
  }
  put(folder / "transforms_test.json", document(named("test/a", R"("mask_path": "m/b.png")")));
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }),
             Contains("transforms_test.json: frame 0: the mask 'm/b.png' does not exist"));
}

TEST_CASE("blender: points are read from ply_file_path and from points3D.ply", "[blender]") {
  const auto points_in = [](const std::string& file, const std::string& head) {
    const TempFolder folder;
    put(folder / "transforms_train.json", document(frame(""), R"("fl_x": 9, "w": 8, "h": 6)" + head));
    put(folder / file,
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "end_header\n1 2 3\n");
    const Dataset data = load_dataset(folder.path(), {.load_images = false});
    return data.points ? data.points->positions.size() : 0;
  };
  CHECK(points_in("cloud.ply", R"(, "ply_file_path": "cloud.ply")") == 1);
  CHECK(points_in("points3D.ply", "") == 1);
  CHECK(points_in("points3d.ply", R"(, "ply_file_path": "none.ply")") == 1);
}

TEST_CASE("blender: missing images and bad frames are skipped, and empty test files are accepted",
          "[blender]") {
  const TempFolder folder;
  put_pictures(folder, {"train/a.png", "train/c.png"});
  put(folder / "transforms_train.json",
      document(named("train/a") + "," + named("train/b") + "," + named("train/c", R"("is_bad": true)")));
  put(folder / "transforms_test.json", document(""));
  Dataset data = load_dataset(folder.path());
  CHECK(data.splits.size() == 1);
  CHECK(data.splits[0].views.size() == 1);
  CHECK_THAT(notes_of(data), Contains("1 skipped: the image does not exist (train/b)") &&
                                 Contains("1 skipped: the frame has 'is_bad': true (train/c)") &&
                                 Contains("no test split: transforms_test.json has no frames"));
  put(folder / "transforms_train.json", document(named("train/a", R"("is_bad": true)")));
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("all frames have 'is_bad': true"));
  put(folder / "transforms_train.json", document(""));
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }),
             Contains("transforms_train.json: 'frames' must be a non-empty array"));
}

TEST_CASE("blender: notes describe test views with unusual times, files or names", "[blender]") {
  const TempFolder folder;
  put_pictures(folder, {"train/a.png", "train/b.png"});
  const auto timed = [](const char* name, double t) { return named(name, fmt::format(R"("time": {})", t)); };
  put(folder / "transforms_train.json", document(timed("train/a.jpg", 0) + "," + timed("train/b.jpg", 2)));
  put(folder / "transforms_test.json", document(timed("train/a.jpg", 1) + "," + timed("train/b.jpg", 3)));
  const std::string notes = notes_of(load_dataset(folder.path()));
  CHECK_THAT(notes,
             Contains("the times of 1 of the 2 views of the split test are outside of the range of the "
                      "training times (0 to 2)") &&
                 Contains("2 images of the split test are also training images") &&
                 Contains("4 images found under slightly different names") &&
                 !Contains("2 images found under"));
}

TEST_CASE("the scene extent is 1.1 times the largest distance of a camera from the mean of all cameras",
          "[blender]") {
  std::vector<View> views(3);
  views[0].camera.translation = {3, 0, 0};  // identity rotation: centre = -translation
  views[1].camera.translation = {-3, 0, 0};
  views[2].camera.translation = {0, 0, 6};
  // Mean (0, 0, -2): distances sqrt(13), sqrt(13), 4.
  CHECK(scene_extent(views) == Approx(1.1 * 4).epsilon(1e-14));
  CHECK(scene_extent(std::span(views).first(1)) == 0.0);
  CHECK_THAT(message_of([] { scene_extent({}); }), Contains("no views"));
}

TEST_CASE("blender: the static dataset lego is loaded", "[blender]") {
  UBS_REQUIRE_DATA(folder, "lego_200");
  const Split train = load_blender_split(folder, "train");
  CHECK(train.views.size() == 100);
  CHECK(load_blender_split(folder, "test").views.size() == 25);
  CHECK_FALSE(has_blender_split(folder, "val"));
  double brightness = 0;
  for (const View& view : train.views) {
    CHECK(view.camera.width == 200);
    CHECK(view.image.rgb.size() == 3 * 200 * 200);
    CHECK(view.camera.fx == Approx(100 / std::tan(0.6911112070083618 / 2)));
    const auto c = view.camera.centre();
    CHECK(std::hypot(c[0], c[1], c[2]) == Approx(4.0311289).epsilon(1e-5));
    const auto pixel = project(view.camera, {0, 0, 0});  // these cameras look at the origin
    CHECK(pixel[0] == Approx(100).margin(1e-3));
    CHECK(pixel[1] == Approx(100).margin(1e-3));
    for (const std::uint8_t v : view.image.rgb) brightness += v;
  }
  CHECK(brightness / (100 * 3 * 200 * 200) > 10);  // black background, but not a black image
  CHECK(scene_extent(train.views) > 4);
}

TEST_CASE("blender: a real dynamic data set is loaded, and its test times are inside the training times",
          "[blender]") {
  UBS_REQUIRE_DATA(folder, "mujoco_dyn_scene10_texture_400");
  DatasetOptions options;
  options.load_images = false;
  const Split test = load_blender_split(folder, "test", options);
  CHECK(test.views.front().camera.time == Approx(0.09395973154362416));
  CHECK(test.views.back().camera.time == Approx(0.912751677852349));
  // The cameras of this data set differ, so fl_x of the frame (482.84) must take precedence over the focal
  // length that follows from camera_angle_x of the file (428.90).
  CHECK(test.views[0].camera.fx == Approx(482.8427124746));
}

namespace {

// Writes a PLY file with `count` points. `position()` returns the position of the next point, and
// `colour(position)` returns its grey value.
template <typename Position, typename Colour>
void put_points(const std::filesystem::path& file, int count, Position position, Colour colour) {
  std::string text = fmt::format(
      "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
      count);
  for (int i = 0; i < count; ++i) {
    const std::array<double, 3> p = position();
    const int c = colour(p);
    text += fmt::format("{} {} {} {} {} {}\n", p[0], p[1], p[2], c, c, c);
  }
  put(file, text);
}

}  // namespace

TEST_CASE("blender: random points that 3DGS code has written into the folder are not used", "[blender]") {
  std::mt19937 generator(3);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(generator);
  };
  const auto in_box = [&] { return std::array{uniform(-1.3, 1.3), uniform(-1.3, 1.3), uniform(-2, 0.5)}; };
  const auto on_sphere = [&] {
    std::array<double, 3> p;
    do p = {uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)};
    while (std::hypot(p[0], p[1], p[2]) > 1 || std::hypot(p[0], p[1], p[2]) < 0.5);
    const double length = std::hypot(p[0], p[1], p[2]);
    return std::array{p[0] / length, p[1] / length, p[2] / length};
  };
  using Point = const std::array<double, 3>&;
  const auto grey = [](Point) { return 127; };
  const auto any = [&](Point) { return static_cast<int>(uniform(0, 256)); };
  const auto by_place = [&](Point p) { return static_cast<int>(127 + 60 * p[0] + uniform(-40, 40)); };
  const TempFolder folder;
  put(folder / "transforms_train.json", document(frame("")));
  const auto points_of = [&](std::string& note) {
    const Dataset data = load_dataset(folder.path(), {.load_images = false});
    for (const std::string& text : data.report.notes)
      if (text.find("points3d.ply") != std::string::npos) note = text;
    return data.points ? data.points->positions.size() : 0;
  };
  for (const int count : {2000, 30000}) {
    INFO(count);
    const auto taken = [&](auto position, auto colour) {
      put_points(folder / "points3d.ply", count, position, colour);
      std::string note;
      const std::size_t points = points_of(note);
      CHECK((points == 0) == (note.find("not used") != std::string::npos));
      return points > 0;
    };
    CHECK_FALSE(taken(in_box, grey));
    CHECK_FALSE(taken(in_box, any));
    CHECK(taken(in_box, by_place));
    CHECK(taken(on_sphere, grey));
    CHECK(taken(on_sphere, any));
  }
  put_points(folder / "points3d.ply", 300, in_box, grey);  // too few points to decide whether they are random
  std::string note;
  CHECK(points_of(note) == 300);
}
