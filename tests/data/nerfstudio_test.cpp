// SPDX-License-Identifier: Apache-2.0
// Tests nerfstudio, LLFF and N3V folders, and the detection of layouts.
#include <cctype>
#include <map>
#include <opencv2/imgcodecs.hpp>

#include "host/dataset/colmap.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/npy.hpp"
#include "host/dataset/packed.hpp"
#include "host/dataset/undistort.hpp"
#include "host/dataset/video_writer.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/frustum_points.hpp"
#include "tests/support/data.hpp"
#include "tests/support/images.hpp"
#include "tests/support/llff.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

std::string nerfstudio_json(const std::string& head, const std::string& more = "", int frames = 4,
                            double offset = 0) {
  std::string text = "{" + head + "\"frames\": [";
  for (int i = 0; i < frames; ++i)
    text += fmt::format(
        R"({}{{"file_path": "images/f{}.png", "transform_matrix": [[1,0,0,{}],[0,1,0,{}],[0,0,1,0],[0,0,0,1]]{}}})",
        i ? "," : "", i, offset + i, offset, more);
  return text + "]}";
}

void put_frames(const TempFolder& folder, int frames = 4) {
  for (int i = 0; i < frames; ++i) put_image(folder / fmt::format("images/f{}.png", i), 64, 48, i);
}

const std::string kHead = R"("w": 64, "h": 48, "fl_x": 50, "fl_y": 51, "cx": 31, "cy": 25, )";

}  // namespace

TEST_CASE("nerfstudio: intrinsics, splits, points and masks are read", "[nerfstudio]") {
  TempFolder folder;
  put_frames(folder);
  put(folder / "p.ply",
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
      "property uint8 red\nproperty uint8 green\nproperty uint8 blue\nend_header\n1 2 3 4 5 6\n-1 0.5 2 7 8 "
      "9\n");
  Image8 mask{64, 48, std::vector<std::uint8_t>(64 * 48 * 3, 0)};
  save_png(folder / "mask.png", mask);
  put(folder / "transforms.json",
      nerfstudio_json(kHead + R"("ply_file_path": "p.ply", )", R"(, "mask_path": "mask.png")"));
  DatasetOptions options;
  options.background = {1, 0, 0};
  options.read.test_every = 8;
  const Dataset data = load_dataset(folder.path(), options);
  CHECK(data.report.layout == "nerfstudio");
  CHECK(data.find("test")->views.size() == 1);
  CHECK(data.find("train")->views.size() == 3);
  const Camera& c = data.find("train")->views[0].camera;
  CHECK(std::array{c.fx, c.fy, c.cx, c.cy} == std::array{50.0, 51.0, 31.0, 25.0});
  CHECK(c.centre()[0] == Approx(1));
  CHECK(c.rotation[8] == -1);  // cameras of OpenGL look along -z
  CHECK(data.points->positions[1] == std::array<float, 3>{-1, 0.5f, 2});
  CHECK(data.points->colours[0] == std::array<std::uint8_t, 3>{4, 5, 6});
  CHECK(data.find("train")->views[0].image.mask == std::vector<std::uint8_t>(64 * 48, 0));
  put(folder / "p.ply",
      "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
      "end_header\n");
  CHECK_FALSE(load_dataset(folder.path(), options).points);  // COLMAP may write a file without points
}

TEST_CASE("nerfstudio: distortion and lists of names are read, and errors name the field", "[nerfstudio]") {
  TempFolder folder;
  put_frames(folder);
  const auto load = [&](const std::string& json) {
    put(folder / "transforms.json", json);
    return load_dataset(folder.path());
  };
  Dataset data = load(nerfstudio_json(kHead + R"("camera_model": "OPENCV", "k1": -0.1, "p1": 0.001, )"));
  CHECK(std::ranges::any_of(data.report.notes,
                            [](const std::string& n) { return n.find("undistorted") != n.npos; }));
  CHECK(data.splits[0].views[0].image.width == data.splits[0].views[0].camera.width);
  data = load(nerfstudio_json(kHead + R"("camera_model": "OPENCV_FISHEYE", "k1": 0.01, )"));
  const auto size = [](const Dataset& d) { return d.splits[0].views[0].camera.width; };
  const int fisheye = size(data), plain = size(load(nerfstudio_json(kHead + R"("k1": 0.01, )")));
  CHECK(fisheye != 64);
  CHECK(fisheye != plain);
  CHECK(size(load(nerfstudio_json(kHead + R"("is_fisheye": true, "k1": 0.01, )"))) == fisheye);
  CHECK(size(load(nerfstudio_json(kHead + R"("is_fisheye": false, "k1": 0.01, )"))) == plain);
  CHECK(size(load(nerfstudio_json(kHead + R"("k1": 0.01, )", R"(, "is_fisheye": true)"))) == fisheye);
  CHECK(size(load(nerfstudio_json(kHead + R"("camera_model": "opencv_fisheye", "k1": 0.01, )"))) == fisheye);
  CHECK(size(load(nerfstudio_json(kHead + R"("camera_model": "Simple_Radial_Fisheye", "k1": 0.01, )"))) ==
        fisheye);
  CHECK(size(load(nerfstudio_json(kHead + R"("camera_model": "FULL_OPENCV", "k1": 0.01, )"))) == plain);
  CHECK(size(load(nerfstudio_json(kHead + R"("camera_model": "FULL_OPENCV", "k1": 0.01, "k4": 0.3, )"))) >
        plain);
  data = load(nerfstudio_json(
      kHead +
      R"("train_filenames": ["images/f0.png", "./images/f2.png"], "test_filenames": ["images/f3.png"], )"));
  CHECK(data.find("train")->views.size() == 2);
  CHECK(data.find("test")->views[0].name == "f3");
  CHECK(data.report.skipped.at(0).examples == std::vector<std::string>{"images/f1.png"});
  data = load(nerfstudio_json(
      kHead +
      R"("val_filenames": ["images/f0.png"], "test_filenames": ["images/f0.png", "images/f3.png"], )"));
  CHECK(data.find("train")->views.size() == 2);
  CHECK(data.find("train")->views[0].name == "f1");
  CHECK(data.find("val")->views.size() == 1);
  CHECK(data.find("test")->views.size() == 2);
  CHECK(data.report.skipped.empty());
  CHECK(std::ranges::any_of(data.report.notes,
                            [](const std::string& n) { return n.find("no train_filenames") != n.npos; }));
  data = load(nerfstudio_json(kHead + R"("test_filenames": ["images/f1.png"], )"));
  CHECK(data.find("train")->views.size() == 3);
  CHECK(data.find("test")->views[0].name == "f1");

  const auto refusal = [&](const std::string& json) { return message_of([&] { load(json); }); };
  CHECK_THAT(refusal(nerfstudio_json(kHead + R"("camera_model": "VR180_L", )")),
             Contains("'VR180_L' is not known") && Contains("PERSPECTIVE") && Contains("EQUIRECTANGULAR"));
  CHECK_THAT(refusal(nerfstudio_json(kHead + R"("k4": 0.1, )")), Contains("'k4'"));
  CHECK_THAT(refusal(nerfstudio_json(kHead, R"(, "mask_path": "none.png")")),
             Contains("frame 0: the mask 'none.png' does not exist") && Contains("searched in"));
  CHECK_THAT(refusal("{"), Contains("transforms.json"));
}

// Writes the name of each camera model in lower case, together with its parameters. The camera of the view
// must be equal to that of a COLMAP model with the same parameters.
TEST_CASE("nerfstudio: all camera models of COLMAP are read", "[nerfstudio]") {
  for (const LensModel& model : lens_models()) {
    if (model.number < 0) continue;  // not a model of COLMAP
    const TempFolder folder;
    put_frames(folder);
    std::string name(model.name),
        fields = R"("w": 64, "h": 48, "fl_x": 50, "fl_y": 50, "cx": 30, "cy": 26, )";
    std::ranges::transform(name, name.begin(), [](char c) { return static_cast<char>(std::tolower(c)); });
    std::vector<double> parameters;
    double next = 0.02;
    for (const std::string_view parameter : words_of(model.parameters)) {
      const std::map<std::string_view, double> fixed{{"f", 50},     {"fx", 50},    {"fy", 50}, {"cx", 30},
                                                     {"cy", 26},    {"w", 64},     {"h", 48},  {"alpha", 0.4},
                                                     {"beta", 1.2}, {"omega", 0.5}};
      const auto found = fixed.find(parameter);
      parameters.push_back(found != fixed.end() ? found->second : (next *= -0.7));
      fields += fmt::format("\"{}\": {}, ", parameter, parameters.back());
    }
    // 'w' and 'h' above are the size of the image in this file.
    put(folder / "transforms.json",
        nerfstudio_json(fields + fmt::format("\"camera_model\": \"{}\", ", name)));
    INFO(name);
    const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 8}});
    const Lens lens = make_colmap_camera(std::string(model.name), 64, 48, parameters, "test").lens;
    const Camera& camera = data.splits[0].views[0].camera;
    if (!lens.distorted()) {
      CHECK(std::array{camera.fx, camera.cx, camera.cy} == std::array{lens.fx, lens.cx, lens.cy});
      continue;
    }
    const std::vector<Undistortion> plans = plan_views(lens, "test");
    const Undistortion& plan =
        plans.size() == 6 ? plans[2] : plans[0];  // "back" is the first in alphabetical order
    CHECK(data.splits[0].views.size() == 3 * plans.size());
    CHECK(data.splits[0].views[0].part_of == (plans.size() == 6 ? "f1" : ""));
    CHECK(std::array{camera.fx, camera.cx, camera.cy} == std::array{plan.fx, plan.cx, plan.cy});
    CHECK(std::array{camera.width, camera.height} == std::array{plan.width, plan.height});
  }
}

TEST_CASE("nerfstudio: a fractional size matches an image whose size differs by less than a pixel",
          "[nerfstudio]") {
  const TempFolder folder;
  put_frames(folder);
  put(folder / "transforms.json", nerfstudio_json(R"("w": 64.8, "h": 48.6, "fl_x": 81, "cx": 32.4, )"));
  const Camera c = load_dataset(folder.path()).find("train")->views[0].camera;
  CHECK(std::array{c.width, c.height} == std::array{64, 48});
  CHECK(c.fx == Approx(80).epsilon(1e-14));
  CHECK(c.cx == Approx(32).epsilon(1e-14));
  CHECK(c.cy == Approx(24).epsilon(1e-14));
}

TEST_CASE("nerfstudio: backslashes of Windows separate folders if this leads to a file", "[nerfstudio]") {
  const TempFolder folder;
  put_frames(folder, 2);
  std::string json = nerfstudio_json(kHead, "", 2);
  for (const char* name : {"f0", "f1"})
    json.replace(json.find(std::string("images/") + name), 9, std::string(R"(images\\)") + name);
  const auto names = [&](const char* file) {
    put(folder / file, json);
    const Dataset data = load_dataset(folder.path());
    std::vector<std::string> found;
    for (const Split& split : data.splits)
      for (const View& view : split.views)
        if (view.has_image()) found.push_back(view.name);
    std::ranges::sort(found);
    return found;
  };
  const std::vector<std::string> both{"f0", "f1"};
  CHECK(names("transforms.json") == both);
  CHECK(names("transforms_train.json") == both);
  put_image(folder / R"(images\f1.png)", 64, 48, 1);
  CHECK(names("transforms_train.json") == std::vector<std::string>{"f0", R"(images%5Cf1)"});
}

TEST_CASE("nerfstudio: fields of other programs are read, or refused, or described by a note",
          "[nerfstudio]") {
  const TempFolder folder;
  put_frames(folder);
  const auto opened = [&](const std::string& json) {
    put(folder / "transforms.json", json);
    return load_dataset(folder.path(), {.read = {.test_every = 0}});
  };
  const auto refusal = [&](const std::string& head, const std::string& more = "") {
    return message_of([&] { opened(nerfstudio_json(head, more)); });
  };
  CHECK_THAT(refusal(kHead + R"("latlong": true, )"), Contains("'latlong' of instant-ngp is not supported"));
  CHECK_THAT(refusal(kHead, R"(, "ftheta_p1": 0.1)"), Contains("frame 0: 'ftheta_p1'"));
  CHECK_THAT(refusal(kHead + R"("rolling_shutter": [0, 0, 0.5, 0], )"), Contains("'rolling_shutter'"));
  CHECK_THAT(refusal(kHead + R"("omega": 0.5, )"), Contains("'omega' = 0.5 is not a coefficient"));
  CHECK_THAT(refusal(R"("w": 64, "fl_x": 50, )"), Contains("frame 0: 'w' is given without 'h'"));
  CHECK_THAT(refusal(kHead, R"(, "is_bad": 1)"), Contains("frame 0: 'is_bad' must be true or false"));
  CHECK_THAT(refusal(kHead, R"(, "is_bad": true)"), Contains("all frames have 'is_bad': true"));
  CHECK(refusal(kHead + R"("latlong": false, "rolling_shutter": [0, 0, 0, 0], )").empty());
  std::string json = nerfstudio_json(kHead);
  json.replace(json.find("\"images/f2"), 0, R"("x", "time": 3, "file_path": )");
  CHECK_THAT(message_of([&] { opened(json); }), Contains("frame 0: 'time' is missing"));

  const auto notes = [&](const std::string& head) {
    std::string text;
    for (const std::string& note : opened(nerfstudio_json(head)).report.notes) text += note + "\n";
    return text;
  };
  CHECK(notes(kHead).empty());
  CHECK_THAT(notes(kHead + R"("fisheye_crop_radius": 9, )"), Contains("'fisheye_crop_radius' is not used"));
  CHECK_THAT(
      notes(R"("w": 64, "h": 48, "fl_x": 0.8, "fl_y": 1.1, "cx": 0.5, "cy": 0.5, )"),
      Contains("the angle of view of 4 pinhole views is larger than 170 degrees") && Contains("in pixels"));
  CHECK_THAT(notes(R"("w": 64, "h": 48, "fl_x": 50, "cx": 70, "cy": 24, )"),
             Contains("the principal point of 4 views is outside of the image (such as f0: 70, 24"));
  CHECK_THAT(notes(R"("w": 64, "h": 48, "camera_model": "EQUIRECTANGULAR", )"),
             Contains("panoramas have 64x48 pixels, so they are not twice as wide as high"));
}

TEST_CASE("nerfstudio: the frames of test_frames are test views, and bad frames are skipped",
          "[nerfstudio]") {
  const TempFolder folder;
  put_frames(folder);
  const std::string all = nerfstudio_json(kHead);
  const std::size_t list = all.find("[{");
  const auto with_test = [&](const std::string& frames, const std::string& more = "") {
    return fmt::format(R"({}, "test_frames": {}{}}})", all.substr(0, all.size() - 1), frames, more);
  };
  const auto load = [&](const std::string& json) {
    put(folder / "transforms.json", json);
    return load_dataset(folder.path(), {.read = {.test_every = 0}});
  };
  put_image(folder / "images/t.png", 64, 48), put_image(folder / "images/u.png", 64, 48);
  std::string test = nerfstudio_json("", "", 2);
  test = test.substr(test.find("[{"), test.size() - test.find("[{") - 1);
  test.replace(test.find("f0"), 2, "t"), test.replace(test.find("f1"), 2, "u");
  Dataset data = load(with_test(test));
  CHECK(data.find("train")->views.size() == 4);
  REQUIRE(data.find("test"));
  CHECK(data.find("test")->views.size() == 2);
  CHECK(data.find("test")->views[0].name == "t");
  CHECK(data.report.differences.empty());

  std::string bad = test;
  bad.insert(2, R"("is_bad": true, )");
  data = load(with_test(bad));
  CHECK(data.find("test")->views.size() == 1);
  CHECK(data.report.skipped.at(0).examples == std::vector<std::string>{"images/t.png"});
  // Every test image is also a training image.
  data = load(with_test(all.substr(list, all.size() - list - 1)));
  CHECK_THAT(data.report.differences.back(), Contains("4 images of the split test are also training images"));
  CHECK(load(with_test("[]")).splits.size() == 1);
  CHECK_THAT(message_of([&] { load(with_test(test, R"(, "train_filenames": ["images/f0.png"])")); }),
             Contains("both 'test_frames' and lists"));
  CHECK_THAT(message_of([&] { load(with_test("[1]")); }), Contains("test_frame 0: must be an object"));
}

TEST_CASE("nerfstudio: a rotation that was rounded to three decimal places is replaced by the nearest one",
          "[nerfstudio]") {
  const TempFolder folder;
  put_frames(folder, 1);
  const auto load = [&](const char* matrix) {
    put(folder / "transforms.json",
        "{" + kHead + R"("frames": [{"file_path": "images/f0.png", "transform_matrix": )" + matrix + "}]}");
    return load_dataset(folder.path(), {.read = {.test_every = 0}});
  };
  // The last row and column are exact. The others are a rotation by 45 degrees: cos(45) = 0.70711.
  const Dataset data = load("[[0.706,-0.707,0,1],[0.707,0.706,0,2],[0,0,1,3],[0,0,0,1]]");
  CHECK_THAT(data.report.notes.at(0), Contains("1 poses were rounded so coarsely"));
  const Camera& c = data.splits[0].views[0].camera;
  const double length = std::hypot(0.706, 0.707);
  CHECK(c.rotation[0] == Approx(0.706 / length).epsilon(1e-14));
  CHECK(c.rotation[1] == Approx(0.707 / length).epsilon(1e-14));
  CHECK(c.centre()[1] == Approx(2).epsilon(1e-14));
  CHECK_THAT(message_of([&] { load("[[0.7,-0.7,0,1],[0.7,0.7,0,2],[0,0,1,3],[0,0,0,1]]"); }),
             Contains("is not a rotation"));
}

TEST_CASE("nerfstudio: --images selects another folder of images, also in the Blender layout", "[dataset]") {
  for (const char* file : {"transforms.json", "transforms_train.json"}) {
    const TempFolder folder;
    for (int i = 0; i < 4; ++i)
      for (const int factor : {2, 4})
        put_image(folder / fmt::format("images_{}/f{}.png", factor, i), 64 / factor, 48 / factor, i);
    put(folder / file, nerfstudio_json(kHead));
    DatasetOptions options;
    CHECK_THAT(message_of([&] { load_dataset(folder.path(), options); }),
               Contains("none of the 4 images exists") && Contains("--images images_2"));
    options.read.images = "images_2";
    const Dataset data = load_dataset(folder.path(), options);
    const View& view = data.splits[0].views[0];
    CHECK(view.file == folder / fmt::format("images_2/{}.png", view.name));
    CHECK(view.camera.width == 32);
    CHECK(view.camera.fx == Approx(25));
    for (const std::string& note : data.report.notes) CHECK_THAT(note, !Contains("slightly different names"));
    options.read.images = "none";
    CHECK_THAT(message_of([&] { load_dataset(folder.path(), options); }),
               Contains("the image folder 'none' does not exist"));
  }
}

TEST_CASE("dataset: if the data are in another folder, the error names it", "[dataset]") {
  const auto refusal = [](const std::vector<std::string>& files, const std::string& passed = "") {
    const TempFolder folder;
    for (const std::string& file : files)
      if (file.ends_with(".png"))
        put_image(folder / file, 8, 6);
      else
        put(folder / file, file.ends_with("images.txt") ? "1 1 0 0 0 0 0 0 1 a.png\n\n" : "{}");
    const std::string message = message_of([&] { load_dataset(folder / passed); });
    return message.substr(message.find(": ") + 2);
  };
  CHECK_THAT(refusal({"scene/transforms.json"}),
             Contains("one of its subfolders is: pass /") && Contains("/scene (nerfstudio)"));
  CHECK_THAT(refusal({"a/lego/transforms_train.json"}), Contains("/a/lego (blender)"));
  CHECK_THAT(refusal({"a/transforms.json", "b/poses_bounds.npy"}),
             Contains("some of its subfolders are: pass one of /") && Contains("/b (llff)"));
  CHECK_THAT(refusal({"s/sparse/0/cameras.txt", "s/sparse/0/images.txt", "s/images/a.png"}),
             Contains("/s (colmap)"));
  CHECK_THAT(refusal({"sparse/0/cameras.txt", "sparse/0/images.txt", "images/a.png"}, "sparse"),
             Contains("pass the folder above it, /") && Contains(" (colmap)"));
  for (const std::string model : {"colmap", "sparse/0/0"}) {
    const std::string message =
        refusal({model + "/cameras.txt", model + "/images.txt", "rgb/a.png", "rgb/b.png"});
    CHECK_THAT(message, Contains("there is a COLMAP model in /") && Contains("/" + model + " --images ../") &&
                            Contains("../rgb"));
  }
  CHECK_THAT(refusal({"distorted/sparse/0/cameras.txt", "distorted/sparse/0/images.txt", "input/a.png"}),
             Contains("/distorted --images ../input"));
  CHECK_THAT(refusal({"sparse/0/cameras.bin.gz", "images/a.png", "images/b.png"}), Contains("gunzip /"));
  CHECK_THAT(refusal({"model.ply", "config.yaml", "metrics.json"}),
             Contains("the output folder of a training run"));
  CHECK_THAT(refusal({"config.yaml", "log.csv"}), Contains("the output folder of a training run"));
  CHECK_THAT(refusal({"a.png", "b.png"}), Contains("2 images but no cameras"));
}

TEST_CASE("dataset: a JSON file without frames is not suggested, and the extension may be in capitals",
          "[dataset]") {
  const TempFolder folder;
  put_frames(folder);
  put(folder / "settings.json", R"({"frames": {"first": 0}})");
  put(folder / "empty.json", R"({"frames": []})");
  put(folder / "damaged.json", R"({"frames": [)");
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("4 images but no cameras"));
  put(folder / "TRANSFORMS.JSON", nerfstudio_json(kHead));
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }),
             Contains("no transforms.json, but TRANSFORMS.JSON has frames"));
  CHECK(load_dataset(folder / "TRANSFORMS.JSON").splits[0].views.size() == 3);
}

TEST_CASE("dataset: the error for an unknown folder lists the supported layouts", "[dataset]") {
  TempFolder folder;
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("poses_bounds.npy"));
  CHECK_THAT(message_of([&] { load_dataset(folder / "none"); }), Contains("no such data folder"));
  DatasetOptions options;
  options.read.layout = "other";
  CHECK_THAT(message_of([&] { load_dataset(folder.path(), options); }, ErrorKind::usage),
             Contains("'other'"));
}

TEST_CASE("dataset: errors for a ZIP file and for an unusual name of a JSON file say what to do",
          "[dataset]") {
  const TempFolder folder;
  put(folder / "scan.zip", "PK\x03\x04 and more");
  CHECK_THAT(message_of([&] { load_dataset(folder / "scan.zip"); }),
             Contains("ZIP") && Contains("unpack it first"));
  put(folder / "d/transforms_colmap.json", nerfstudio_json(kHead));
  CHECK_THAT(message_of([&] { load_dataset(folder / "d"); }),
             Contains("give the file itself: ") && Contains("d/transforms_colmap.json"));
}

TEST_CASE("dataset: the error for NaN in a transforms file contains frame and field", "[dataset]") {
  const TempFolder folder;
  put_frames(folder);
  std::string json = nerfstudio_json(kHead);
  json.replace(json.find("[[1,0,0,2]"), 10, "[[1,0,0,NaN]");
  put(folder / "transforms.json", json);
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }),
             Contains("frame 2: 'transform_matrix' has the value NaN"));
  put(folder / "transforms.json",
      nerfstudio_json(R"("note": "a NaN \"", "w": 64, "h": -Infinity, "fl_x": 50, )"));
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("'h' has the value -Infinity"));
}

TEST_CASE("dataset: errors name unsupported image formats", "[dataset]") {
  const TempFolder folder;
  const auto refusal = [&](const std::string& name, const std::string& bytes) {
    put(folder / "images" / name, bytes);
    std::string json = nerfstudio_json(kHead, "", 1);
    json.replace(json.find("f0.png"), 6, name);
    put(folder / "transforms.json", json);
    return message_of([&] { load_dataset(folder.path()); });
  };
  CHECK_THAT(refusal("a.avif", std::string("\0\0\0\x20", 4) + "ftypavif0000"),
             Contains("a.avif: format AVIF is not supported: convert to JPEG or PNG"));
  CHECK_THAT(refusal("b.heic", std::string("\0\0\0\x20", 4) + "ftypheic0000"),
             Contains("format HEIC is not supported"));
  CHECK_THAT(refusal("c.gif", "GIF89a0000000000"), Contains("format GIF is not supported"));
  CHECK_THAT(refusal("d.png", "GIF89a0000000000"), Contains("format GIF is not supported"));
  std::filesystem::remove(folder / "images/b.heic");
  CHECK_THAT(refusal("x.heic", "0"), Contains("x.heic"));
  for (const char* name : {"e.jfif", "f.JPE"}) {
    REQUIRE(cv::imwrite((folder / "g.jpg").string(), cv::Mat(48, 64, CV_8UC3, cv::Scalar(9, 9, 9))));
    std::filesystem::create_directories(folder / "images");
    std::filesystem::rename(folder / "g.jpg", folder / "images" / name);
    std::string json = nerfstudio_json(kHead, "", 1);
    json.replace(json.find("f0.png"), 6, name);
    put(folder / "transforms.json", json);
    CHECK(load_dataset(folder.path(), {.read = {.test_every = 0}}).find("train")->views.at(0).has_image());
  }
}

TEST_CASE("llff: masks in a folder next to the images are used", "[llff]") {
  const TempFolder folder;
  put_rows(folder.path(), 2);
  for (const char* name : {"images/0.png", "images/1.png", "masks/1.png"}) put_image(folder / name, 128, 96);
  const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 0}});
  const std::vector<View>& views = data.find("train")->views;
  CHECK(views[0].image.mask.empty());
  CHECK(views[1].image.mask.size() == 128 * 96);
}

TEST_CASE("llff: hidden files of macOS are not images", "[llff]") {
  const TempFolder folder;
  put_rows(folder.path(), 2);
  for (const char* name : {"images/0.png", "images/1.png"}) put_image(folder / name, 128, 96);
  put(folder / "images/._0.png", "resource fork");
  CHECK(load_dataset(folder.path(), {.read = {.test_every = 0}}).find("train")->views.size() == 2);
}

TEST_CASE("dataset: settings that a layout does not use are rejected", "[dataset]") {
  const TempFolder folder;
  const auto refusal = [&](const char* file, const DatasetOptions& options) {
    put(folder / file, "{}");
    return message_of([&] { load_dataset(folder.path(), options); }, ErrorKind::usage);
  };
  CHECK_THAT(refusal("transforms.json", {.read = {.colmap_model = "1"}}),
             Contains("nerfstudio does not use --colmap-model"));
  CHECK_THAT(refusal("transforms.json", {.read = {.frames = {.end = 3}}}), Contains("not use --frames"));
  CHECK_THAT(refusal("transforms_train.json", {.read = {.test_every = 4}}), Contains("not use --test-every"));
  // Earlier versions recorded test_every = 8 for all layouts, so this value must be accepted.
  CHECK_NOTHROW(refuse_unused({.read = {.test_every = 8}}, "blender", ""));
}

TEST_CASE("dataset: coordinates far from the origin are stored relative to an offset", "[dataset]") {
  TempFolder folder;
  put_frames(folder, 9);
  const double far = 4.0e6;
  put(folder / "transforms.json", nerfstudio_json(kHead, "", 9, far));
  Dataset data = load_dataset(folder.path(), {.read = {.test_every = 8}});
  CHECK(data.offset[0] == Approx(far).epsilon(1e-5));
  CHECK(data.offset[0] == std::round(data.offset[0]));
  const View& view = data.find("train")->views[1];  // f2
  CHECK(view.camera.centre()[0] + data.offset[0] == Approx(far + 2).epsilon(1e-15));
  CHECK(std::abs(view.camera.centre()[0]) < 10);
  rebase(data.splits[0].views, data.offset, {0, 0, 0});
  CHECK(data.splits[0].views[1].camera.centre()[0] == Approx(far + 2).epsilon(1e-15));

  put(folder / "transforms.json", nerfstudio_json(kHead, "", 9, 100));
  CHECK(load_dataset(folder.path()).offset == std::array<double, 3>{});
}

namespace {

// Returns a transforms file whose cameras have different rotations. Their positions are `centre` plus
// `spread` times numbers from -1 to 1.
std::string frames_around(const std::array<double, 3>& centre, double spread, bool as_float = false) {
  std::string text = "{" + kHead + "\"frames\": [";
  for (int i = 0; i < 24; ++i) {
    const double angle = 0.26 * i, c = std::cos(angle), s = std::sin(angle);
    std::array<double, 3> at = centre;
    for (std::size_t k = 0; k < 3; ++k) {
      at[k] += spread * std::cos(7 * i + 2.0 * static_cast<double>(k));
      if (as_float) at[k] = static_cast<float>(at[k]);
    }
    text += fmt::format(
        R"({}{{"file_path": "images/f{}.png", "transform_matrix": [[{},0,{},{}],[{},0,{},{}],[0,1,0,{}],[0,0,0,1]]}})",
        i ? "," : "", i, c, s, at[0], s, -c, at[1], at[2]);
  }
  return text + "]}";
}

}  // namespace

// Some rows have a mean position that consists of whole numbers. After this mean is subtracted from the
// positions, only rounding errors remain, which must not count as different positions.
TEST_CASE("dataset: at_one_place() works near the origin and far from it", "[dataset]") {
  TempFolder folder;
  put_frames(folder, 24);
  struct Row {
    std::array<double, 3> centre;
    double spread;
    bool as_float, one;
  };
  const auto load = [&](const std::filesystem::path& path) {
    return open_undecoded(path, {.load_images = false});
  };
  for (const Row& row :
       {Row{{0, -3, 1}, 0, false, true}, Row{{0, -3, 1}, 4e-16, false, true},
        Row{{0, -3, 1}, 1e-9, false, true}, Row{{0, -3, 1}, 1e-7, false, true},
        Row{{0, -3, 1}, 1e-7, true, true}, Row{{0, -3, 1}, 1e-4, false, false},
        Row{{0, 0, 0}, 0, false, true}, Row{{0, 0, 0}, 4e-16, false, true}, Row{{0, 0, 0}, 1e-9, false, true},
        Row{{0, 0, 0}, 1e-6, false, false}, Row{{1e-7, 0, 0}, 1e-9, false, true},
        Row{{0.3, -3.1, 1}, 4e-16, false, true}, Row{{0.3, -3.1, 1}, 1e-9, false, true},
        Row{{0.3, -3.1, 1}, 1e-7, true, true}, Row{{4e5, -5e6, 300}, 0, false, true},
        Row{{4e5, -5e6, 300}, 1e-8, false, true}, Row{{4e5, -5e6, 300}, 2e-5, false, true},
        Row{{4e5, -5e6, 300}, 0.01, false, false}}) {
    INFO(row.centre[0] << " " << row.centre[1] << " " << row.centre[2] << ", spread " << row.spread);
    put(folder / "transforms.json", frames_around(row.centre, row.spread, row.as_float));
    Dataset data = load(folder.path());
    const std::vector<Camera> cameras = cameras_of(*data.find("train"));
    REQUIRE(cameras.size() == 21);
    CHECK(at_one_place(cameras) == row.one);
    for (const Split& split : data.splits)
      for (const View& view : split.views)
        for (std::size_t k = 0; k < 3; ++k)
          CHECK(std::abs(view.camera.centre()[k] + data.offset[k] - row.centre[k]) <=
                2 * row.spread + (row.as_float ? 1e-7 : 1e-9));
    if (!row.one) continue;
    write_packed(folder / "set.ubsd", {.splits = data.splits, .offset = data.offset});
    const Dataset packed = load(folder / "set.ubsd");
    CHECK(at_one_place(cameras_of(*packed.find("train"))));
    CHECK(packed.offset == data.offset);
  }
}

// The offset is rounded to whole units, or to smaller steps if whole units are large compared with the
// extent.
TEST_CASE("dataset: cameras at one place near the origin are not called far from it", "[dataset]") {
  const TempFolder folder;
  put_image(folder / "images/f0.png", 64, 48);
  std::string frame =
      R"({"file_path": "images/f0.png", "transform_matrix": [[1,0,0,4],[0,1,0,0],[0,0,1,0]]})";
  put(folder / "transforms.json", fmt::format("{{{} \"frames\": [{}, {}]}}", kHead, frame, frame));
  const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 0}});
  CHECK(std::ranges::count(data.report.notes,
                           "all cameras have the same position: coordinates are relative to "
                           "(4, 0, 0)") == 1);
}

TEST_CASE("dataset: the offset keeps the digits of data in a large unit", "[dataset]") {
  TempFolder folder;
  put_frames(folder, 24);
  struct Row {
    std::array<double, 3> centre;
    double spread;
    std::array<double, 3> offset;
  };
  for (const Row& row :
       {Row{{4321987.2, -2.7, 5}, 3, {4321987, -3, 5}}, Row{{4321987.2, -2.7, 5}, 0.01, {4321987, -3, 5}},
        Row{{0.03, -0.04, 0}, 3, {0, 0, 0}}, Row{{0.03, -0.04, 0}, 1e-5, {0.03, -0.04, 0}},
        Row{{12.3456, -0.04, 0}, 1e-4, {12.3456, -0.04, 0}}}) {
    INFO(row.centre[0] << ", spread " << row.spread);
    put(folder / "transforms.json", frames_around(row.centre, row.spread));
    const Dataset data = open_undecoded(folder.path(), {.load_images = false});
    for (std::size_t k = 0; k < 3; ++k) CHECK(std::abs(data.offset[k] - row.offset[k]) <= row.spread / 2);
    if (row.offset[0] == std::round(row.offset[0]))
      for (std::size_t k = 0; k < 3; ++k) CHECK(data.offset[k] == std::round(data.offset[k]));
    // In float32, the distances between cameras keep three digits.
    if (row.spread > 1) continue;
    for (const View& view : data.find("train")->views)
      for (const double x : view.camera.centre())
        CHECK(std::abs(static_cast<float>(x) - x) < 1e-3 * row.spread);
  }
}

TEST_CASE("dataset: images that do not fit into the cache are decoded on demand, with the same pixels",
          "[dataset]") {
  TempFolder folder;
  put_frames(folder);
  put(folder / "transforms.json", nerfstudio_json(kHead));
  DatasetOptions options;
  const Dataset all = load_dataset(folder.path(), options);
  options.read.image_cache_mb = 0;
  const Dataset some = load_dataset(folder.path(), options);
  CHECK(some.splits[0].views[0].image.rgb.empty());
  CHECK(some.splits[0].views[0].has_image());
  CHECK(some.splits[0].views[0].load_image().rgb == all.splits[0].views[0].image.rgb);
}

TEST_CASE("dataset: the mask of an image counts as memory of the cache", "[dataset]") {
  TempFolder folder;
  put_image(folder / "a.png", 640, 480);  // 0.88 MiB, and 1.17 MiB with a mask
  put_image(folder / "mask.png", 640, 480);
  DatasetOptions options;
  options.read.image_cache_mb = 1;
  for (const bool masked : {false, true}) {
    put(folder / "transforms_train.json",
        fmt::format(R"({{"camera_angle_x": 0.8, "frames": [{{"file_path": "a.png"{}, "transform_matrix":
                    [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]}}]}})",
                    masked ? R"(, "mask_path": "mask.png")" : ""));
    const Dataset data = load_dataset(folder.path(), options);
    const View& view = data.splits.at(0).views.at(0);
    CHECK(view.masked == masked);
    CHECK(view.image.rgb.empty() == masked);  // decoded on demand
    CHECK(view.load_image().bytes() == view.image_bytes());
  }
}

TEST_CASE("llff: poses, image sizes and depth bounds are read", "[llff]") {
  TempFolder folder;
  std::vector<double> rows;
  for (int i = 0; i < 9; ++i) {
    add_row(rows, i);
    put_image(folder / fmt::format("images/f{}.png", i), 64, 48, i);
  }
  put_poses(folder / "poses_bounds.npy", rows);
  const Dataset data = load_dataset(folder.path());
  CHECK(data.report.layout == "llff");
  CHECK(data.find("test")->views.size() == 2);
  const Camera& c = data.find("train")->views[1].camera;  // f2
  CHECK(c.width == 64);
  CHECK(c.fx == 50);  // the file states 100 for images of twice the size
  CHECK(c.cx == 32);
  CHECK(c.centre()[0] == Approx(2));
  CHECK(c.rotation[4] == -1);  // the y axis of the camera points down
  CHECK(c.rotation[8] == -1);  // the z axis of the camera points forward
  REQUIRE(data.depth_bounds.size() == 7);

  const PointCloud cloud = sample_frusta(data.find("train")->views, data.depth_bounds, 500, 1);
  double near = 1e9, far = 0;
  for (const auto& p : cloud.positions) {
    near = std::min(near, -static_cast<double>(p[2]));
    far = std::max(far, -static_cast<double>(p[2]));
  }
  CHECK(near > 1.99);
  CHECK(near < 2.2);
  CHECK(far > 6);
  CHECK(far < 9.01);

  rows[3] = std::nan("");
  put_poses(folder / "poses_bounds.npy", rows);
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("row 0: value 3 is not finite"));
  rows.resize(17 * 8);
  rows[3] = 0;
  put_poses(folder / "poses_bounds.npy", rows);
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }),
             Contains("9 images, but poses_bounds.npy has 8 rows"));
}

TEST_CASE("llff: depth bounds are assigned to their views, although the order of the files differs",
          "[llff]") {
  const TempFolder folder;
  std::vector<double> rows;
  for (const char* name : {"a-2", "a"}) {
    put_image(folder / fmt::format("images/{}.png", name), 64, 48);
    add_row(rows, 0);
  }
  rows[17 + 15] = 3;
  put_poses(folder / "poses_bounds.npy", rows);
  const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 0}});
  CHECK(data.find("train")->views.at(0).name == "a");
  CHECK(data.depth_bounds.at(0)[0] == 3);
  CHECK(data.depth_bounds.at(1)[0] == 2);
  put(folder / "walk.mp4", "one video is not two cameras");
  CHECK(load_dataset(folder.path(), {.read = {.test_every = 0}}).find("train")->views.size() == 2);
}

TEST_CASE("n3v: frames of videos become views with times, and the first camera is the test split", "[llff]") {
  TempFolder folder;
  std::vector<double> rows;
  for (int camera = 0; camera < 3; ++camera) {
    add_row(rows, camera);
    VideoWriter writer(folder / fmt::format("cam0{}.avi", camera), 64, 48, 25);
    for (int f = 0; f < 6; ++f) writer.write(plain_image(64, 48, 80 * camera, 40 * f, 10));
    writer.commit();
  }
  put_poses(folder / "poses_bounds.npy", rows);
  DatasetOptions options;
  options.read.image_cache_mb = 0;
  options.read.frames = {.first = 1, .step = 2};
  const Dataset data = load_dataset(folder.path(), options);
  REQUIRE(data.find("train")->views.size() == 6);
  REQUIRE(data.find("test")->views.size() == 3);
  const View& view = data.find("train")->views[4];  // camera 2, frame 3
  CHECK(view.name == "cam02_0003");
  CHECK(view.camera.time == 0.5);
  CHECK(view.camera.fx == 50);
  for (const int i : {5, 3, 4, 3}) {  // frames may also be read backwards
    const View& v = data.find("train")->views[static_cast<std::size_t>(i)];
    const Image8 image = v.load_image();
    CHECK(std::abs(int{image.rgb[0]} - 160) < 6);
    CHECK(std::abs(int{image.rgb[1]} - 40 * (1 + 2 * (i - 3))) < 6);
    CHECK(std::abs(int{image.rgb[2]} - 10) < 6);
  }
}

TEST_CASE("n3v: a playlist with the name of a video opens no other file", "[llff]") {
  TempFolder folder;
  std::vector<double> rows;
  {
    VideoWriter writer(folder / "outside.avi", 64, 48, 25);
    for (int f = 0; f < 2; ++f) writer.write(plain_image(64, 48, 80, 40, 10));
    writer.commit();
  }
  const std::string outside = (folder / "outside.avi").string();
  const std::string playlists[] = {
      "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n" + outside + "\n#EXT-X-ENDLIST\n",
      "ffconcat version 1.0\nfile '" + outside + "'\n"};
  for (int camera = 0; camera < 2; ++camera) add_row(rows, camera);
  put_poses(folder / "data/poses_bounds.npy", rows);
  for (const std::string& playlist : playlists) {
    for (int camera = 0; camera < 2; ++camera) put(folder / fmt::format("data/cam0{}.mp4", camera), playlist);
    CHECK_THAT(message_of([&] { load_dataset(folder / "data"); }),
               Contains("cam00.mp4: cannot open the video"));
  }
}

TEST_CASE("n3v: folders of frames are read", "[llff]") {
  TempFolder folder;
  std::vector<double> rows;
  for (int camera = 0; camera < 2; ++camera) {
    add_row(rows, camera);
    for (int f = 0; f < 3; ++f) put_image(folder / fmt::format("cam0{}/{:04d}.png", camera, f), 64, 48, f);
  }
  put_poses(folder / "poses_bounds.npy", rows);
  const Dataset data = load_dataset(folder.path());
  CHECK(data.find("train")->views.size() == 3);
  CHECK(data.find("test")->views[2].camera.time == 1);
  put_image(folder / "cam01/0003.png", 64, 48);  // one frame more than the other camera
  const Dataset longer = load_dataset(folder.path());
  REQUIRE(longer.find("train")->views.size() == 3);
  CHECK(longer.find("train")->views[1].camera.time == 0.5);
  CHECK_THAT(longer.report.notes.at(0), Contains("cam00 has 3 frames, but cam01 has 4"));
  CHECK_THAT(message_of([&] { load_dataset(folder.path(), {.read = {.test_every = 4}}); }, ErrorKind::usage),
             Contains("N3V does not use --test-every"));
  const Dataset unsplit = load_dataset(folder.path(), {.read = {.test_every = 0}});
  CHECK(unsplit.find("test")->views.size() == 3);
  CHECK(std::ranges::count(unsplit.report.notes,
                           "--test-every 0 has no effect, because the data determine the test views") == 1);
}

TEST_CASE("n3v: frames are in natural order", "[llff]") {
  const TempFolder folder;
  put_rows(folder.path(), 2);
  for (int camera = 0; camera < 2; ++camera)
    for (const char* name : {"f1_0", "f1_1", "f1_2", "f1_9", "f1_010", "f1_11", "f2_1"})
      put_image(folder / fmt::format("cam0{}/{}.png", camera, name), 16, 12);
  DatasetOptions options;
  std::vector<std::string> names;
  const Dataset data = load_dataset(folder.path(), options);
  for (const View& view : data.find("train")->views) names.push_back(view.file.stem().string());
  CHECK(names == std::vector<std::string>{"f1_0", "f1_1", "f1_2", "f1_9", "f1_010", "f1_11", "f2_1"});
  options.read.frames = {.first = 2, .end = 5};
  const Dataset some = load_dataset(folder.path(), options);
  CHECK(some.find("train")->views.at(2).file.stem() == "f1_010");
}

TEST_CASE("llff: links to missing files are errors, because they would shift the other images", "[llff]") {
  for (const char* images : {"images", "cam00"}) {
    const TempFolder folder;
    put_rows(folder.path(), 2);
    for (const char* name : {"0.png", "2.png"}) put_image(folder / images / name, 16, 12);
    std::filesystem::create_symlink("gone.png", folder / images / "1.png");
    CHECK_THAT(message_of([&] { load_dataset(folder.path()); }),
               Contains("1.png: this is a symbolic link to a file that does not exist"));
  }
}

TEST_CASE("llff: unusable depth bounds are not used, and this is reported", "[llff]") {
  const TempFolder folder;
  for (int i = 0; i < 2; ++i) put_image(folder / fmt::format("images/{}.png", i), 128, 96);
  const double inf = std::numeric_limits<double>::infinity();
  for (const auto& [near, far] :
       {std::pair{0.0, 9.0}, {-1, 9}, {5, 2}, {5, 5}, {std::nan(""), 9}, {1, inf}}) {
    std::vector<double> rows;
    add_row(rows, 0), add_row(rows, 1);
    rows[17 + 15] = near, rows[17 + 16] = far;
    put_poses(folder / "poses_bounds.npy", rows);
    const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 0}});
    INFO(near << " " << far);
    CHECK(data.depth_bounds.empty());
    REQUIRE(data.report.differences.size() == 1);
    CHECK_THAT(data.report.differences[0], Contains("the depth bounds of the data are not used"));
  }
}

TEST_CASE("llff: if the image folder does not exist, the error names another image folder", "[llff]") {
  const TempFolder folder;
  put_rows(folder.path(), 2);
  const auto message = [&](const DatasetOptions& options = {}) {
    return message_of([&] { load_dataset(folder.path(), options); });
  };
  CHECK_THAT(message(), Contains("/images: this folder does not exist") && !Contains("--images"));
  for (const char* name : {"0.png", "1.png"}) put_image(folder / name, 128, 96);
  CHECK_THAT(message(), Contains("does not exist: use the images in the data folder with --images ."));
  CHECK(load_dataset(folder.path(), {.read = {.images = ".", .test_every = 0}}).splits.size() == 1);
  for (const char* name : {"images_4/0.png", "images_4/1.png", "images_2/0.png"})
    put_image(folder / name, 32, 24);
  CHECK_THAT(message(), Contains("choose the folder that has the images with --images images_4"));
  CHECK_THAT(message({.read = {.images = "images_8"}}), Contains("images_8: this folder does not exist"));
  CHECK(message({.read = {.images = "images_4"}}).empty());
}

TEST_CASE("llff: the error of a COLMAP model with other names mentions the layout llff", "[llff]") {
  const TempFolder folder;
  put_rows(folder.path(), 1);
  put(folder / "sparse/0/cameras.txt", "1 PINHOLE 128 96 100 100 64 48\n");
  put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 IMG_4026.JPG\n\n");
  put_image(folder / "images_4/image000.png", 32, 24);
  DatasetOptions options{.read = {.images = "images_4", .test_every = 0}};
  CHECK_THAT(message_of([&] { load_dataset(folder.path(), options); }), Contains("with --layout llff"));
  options.read.layout = "llff";
  CHECK(load_dataset(folder.path(), options).find("train")->views.size() == 1);
}

TEST_CASE("llff: the poses of the scene fern are equal to those of its COLMAP model", "[llff][data]") {
  UBS_REQUIRE_DATA(folder, "llff_fern_504");
  DatasetOptions options;
  options.read.layout = "llff";
  options.load_images = true;
  options.image_splits = {"test"};
  const Dataset data = load_dataset(folder, options);
  options.read.layout = "colmap";
  const Dataset sparse = load_dataset(folder, options);
  REQUIRE(data.find("test")->views.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    const Camera &a = data.find("test")->views[i].camera, &b = sparse.find("test")->views[i].camera;
    for (std::size_t k = 0; k < 9; ++k) CHECK(a.rotation[k] == Approx(b.rotation[k]).margin(1e-6));
    for (std::size_t k = 0; k < 3; ++k) CHECK(a.translation[k] == Approx(b.translation[k]).margin(1e-5));
    CHECK(a.fx == Approx(b.fx).epsilon(1e-6));
  }
}
