// SPDX-License-Identifier: Apache-2.0
// Tests the loader of COLMAP folders with text and binary files, every camera model, splits, masks, different
// image sizes, damaged files, and real scenes.
#include "host/dataset/colmap.hpp"

#include <opencv2/imgcodecs.hpp>
#include <set>

#include "host/dataset/load_dataset.hpp"
#include "tests/support/data.hpp"
#include "tests/support/images.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

constexpr const char* kCameras =
    "# comment\n1 PINHOLE 64 48 50 51 33 23\n2 SIMPLE_RADIAL 64 48 50 32 24 0.1\n";
constexpr const char* kPoints = "1 0.5 -1 4 10 20 30 0.7 1 2\n2 1 1 5 40 50 60 0.1\n";

// Returns the text of a file images.txt with ten images, from im9.png to im0.png, all with the given camera.
std::string images_text(int camera = 1) {
  std::string text = "# two lines each\n";
  for (int i = 9; i >= 0; --i)
    text +=
        fmt::format("{} 1 0 0 0 {} 0 0 {} im{}.png\n{}\n", 20 - i, i, camera, i, i % 2 ? "1.5 2.5 7" : "");
  return text;
}

void put_scene(const TempFolder& folder, int camera = 1) {
  put(folder / "sparse/0/cameras.txt", kCameras);
  put(folder / "sparse/0/images.txt", images_text(camera));
  put(folder / "sparse/0/points3D.txt", kPoints);
  for (int i = 0; i < 10; ++i) put_image(folder / fmt::format("images/im{}.png", i), 64, 48, i);
}

template <typename T>
void add(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

std::string binary_camera(int model, const std::vector<double>& parameters) {
  std::string bytes;
  add<std::uint64_t>(bytes, 1);
  add<std::uint32_t>(bytes, 7);
  add<std::int32_t>(bytes, model);
  add<std::uint64_t>(bytes, 320);
  add<std::uint64_t>(bytes, 240);
  for (const double p : parameters) add(bytes, p);
  return bytes;
}

std::string binary_image(const std::string& name, std::uint64_t observations) {
  std::string bytes;
  add<std::uint64_t>(bytes, 1);
  add<std::uint32_t>(bytes, 3);
  for (const double v : {0.5, 0.5, 0.5, 0.5, 1.0, 2.0, 3.0}) add(bytes, v);
  add<std::uint32_t>(bytes, 7);
  bytes += name;
  bytes += '\0';
  add(bytes, observations);
  bytes.append(24 * observations, 'o');
  return bytes;
}

}  // namespace

TEST_CASE("colmap: a text model becomes a data set", "[colmap]") {
  TempFolder folder;
  put_scene(folder);
  const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 8}});
  CHECK(data.report.layout == "colmap");
  CHECK(data.report.skipped.empty());
  REQUIRE(data.find("train")->views.size() == 8);
  REQUIRE(data.find("test")->views.size() == 2);  // the images with the sorted names 0 and 8
  CHECK(data.find("test")->views[0].name == "im0");
  CHECK(data.find("test")->views[1].name == "im8");
  const View& view = data.find("train")->views[2];  // im3: t = (3, 0, 0)
  CHECK(view.name == "im3");
  CHECK(view.camera.translation == std::array<double, 3>{3, 0, 0});
  CHECK(std::array{view.camera.fx, view.camera.fy, view.camera.cx, view.camera.cy} ==
        std::array{50.0, 51.0, 33.0, 23.0});
  CHECK(image_difference(view.image, gradient_image(64, 48, 3)) == 0);
  REQUIRE(data.points);
  CHECK(data.points->positions[1] == std::array<float, 3>{1, 1, 5});
  CHECK(data.points->colours[0] == std::array<std::uint8_t, 3>{10, 20, 30});
}

TEST_CASE("colmap: if there are several models, the largest or the requested one is used", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 im0.png\n\n");
  put(folder / "sparse/2/cameras.txt", kCameras);
  put(folder / "sparse/2/images.txt", images_text());
  const auto views = [&](const std::string& model) {
    const Dataset data = load_dataset(folder.path(), {.read = {.colmap_model = model, .test_every = 0}});
    CHECK_THAT(data.report.notes.at(0), Contains("sparse/0 (1 images), sparse/2 (10 images)"));
    return data.find("train")->views.size();
  };
  CHECK(views("auto") == 10);
  CHECK(views("2") == 10);
  CHECK(views("sparse/2") == 10);
  CHECK(views("0") == 1);
  CHECK_THAT(message_of([&] { views("7"); }, ErrorKind::usage),
             Contains("there is no COLMAP model '7'") && Contains("--colmap-model"));
  std::filesystem::remove_all(folder / "sparse/0");  // sparse/0 is not required
  CHECK(load_dataset(folder.path()).find("train")->views.size() == 8);
}

TEST_CASE("colmap: text files without the empty second lines are read completely", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  put(folder / "sparse/0/images.txt",
      "1 1 0 0 0 0 0 0 1 im0.png\n2 1 0 0 0 1 0 0 1 im1.png\n1.5 2 -1 3 4 7\n3 1 0 0 0 2 0 0 1 im2.png\n\n"
      "4 1 0 0 0 3 0 0 1 im3.png");
  CHECK(load_dataset(folder.path(), {.read = {.test_every = 0}}).find("train")->views.size() == 4);
  put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 im0.png\n1 2 3 4\n");
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }),
             Contains("images.txt:2: quaternion is missing"));
}

TEST_CASE("colmap: text files may start with a byte order mark", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"}) {
    const std::filesystem::path file = folder / "sparse/0" / name;
    const std::string text = get(file);
    put(file, "\xef\xbb\xbf" + (text.starts_with('#') ? text.substr(text.find('\n') + 1) : text));
  }
  const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 0}});
  CHECK(data.find("train")->views.size() == 10);
  CHECK(data.points->positions.size() == 2);
}

TEST_CASE("colmap: each file may be binary or text", "[colmap]") {
  const TempFolder folder;
  put(folder / "cameras.bin", binary_camera(0, {300, 160, 120}));
  put(folder / "images.txt", "3 1 0 0 0 0 0 0 7 a.png\n\n");
  CHECK(read_colmap_model(folder.path()).images.at(0).name == "a.png");
  CHECK(count_colmap_images(folder.path()) == 1);
  std::filesystem::remove(folder / "cameras.bin");
  put(folder / "cameras.txt", "7 PINHOLE 320 240 300 300 160 120\n");
  std::filesystem::remove(folder / "images.txt");
  CHECK_THAT(message_of([&] { read_colmap_model(folder.path()); }),
             Contains("neither images.bin nor images.txt"));
  put(folder / "images.bin", binary_image("b.png", 0));
  CHECK(read_colmap_model(folder.path()).images.at(0).name == "b.png");
  CHECK(count_colmap_images(folder.path()) == 1);
}

TEST_CASE("colmap: cameras that no image has may be invalid, and are reported", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  for (const char* camera : {"3 PINHOLE 0 0 1 1 0 0", "3 UNKNOWN_LENS 64 48 1 2 3"}) {
    put(folder / "sparse/0/cameras.txt", std::string(kCameras) + camera + "\n");
    put(folder / "sparse/0/images.txt", images_text());
    const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 0}});
    CHECK(data.find("train")->views.size() == 10);
    REQUIRE(data.report.skipped.size() == 1);
    CHECK(data.report.skipped[0].examples == std::vector<std::string>{"camera 3"});
    put(folder / "sparse/0/images.txt", images_text(3));
    CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("cameras.txt:4: "));
  }
}

TEST_CASE("colmap: points that are not finite are left out and counted", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  const std::string note = "1 points are not used, because a coordinate is not finite";
  put(folder / "sparse/0/points3D.txt", std::string("9 nan 0 1 1 2 3 0.1\n") + kPoints);
  const Dataset text = load_dataset(folder.path());
  CHECK(text.points->positions.size() == 2);
  CHECK(text.points->colours.at(0) == std::array<std::uint8_t, 3>{10, 20, 30});
  CHECK(std::ranges::count(text.report.differences, note) == 1);

  std::filesystem::remove(folder / "sparse/0/points3D.txt");
  std::string bytes;
  add<std::uint64_t>(bytes, 2);
  for (const double x : {std::nan(""), 5.0}) {
    add<std::uint64_t>(bytes, 1);
    for (const double c : {x, 1.0, 2.0}) add(bytes, c);
    bytes += "\x01\x02\x03";
    add(bytes, 0.5);
    add<std::uint64_t>(bytes, 0);
  }
  put(folder / "sparse/0/points3D.bin", bytes);
  const Dataset binary = load_dataset(folder.path());
  CHECK(binary.points->positions.size() == 1);
  CHECK(std::ranges::count(binary.report.differences, note) == 1);

  std::filesystem::remove(folder / "sparse/0/points3D.bin");
  put(folder / "sparse/0/points3D.ply",
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
      "end_header\n1 2 inf\n1 2 3\n");
  const Dataset ply = load_dataset(folder.path());
  CHECK(ply.points->positions.size() == 1);
  CHECK(std::ranges::count(ply.report.differences, note) == 1);
}

TEST_CASE("colmap: colours of text files may be floating-point numbers", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  const auto colour = [&](const char* line) {
    put(folder / "sparse/0/points3D.txt", line);
    return load_dataset(folder.path()).points->colours.at(0);
  };
  CHECK(colour("1 0 0 1 29.0 30 31.0 0.1\n") == std::array<std::uint8_t, 3>{29, 30, 31});
  CHECK(colour("1 0 0 1 1.0 0.2 0 0.1\n") == std::array<std::uint8_t, 3>{255, 51, 0});
  CHECK_THAT(message_of([&] { colour("1 0 0 1 256 0 0 0.1\n"); }), Contains("points3D.txt:1: colour '256'"));
}

TEST_CASE("colmap: points3D.ply is used if the model has no points", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  std::filesystem::remove(folder / "sparse/0/points3D.txt");
  put(folder / "sparse/0/points3D.ply",
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
      "property float red\nproperty float green\nproperty float blue\nend_header\n1 2 3 1 0.2 0\n");
  const Dataset data = load_dataset(folder.path());
  REQUIRE(data.points);
  CHECK(data.points->colours.at(0) == std::array<std::uint8_t, 3>{255, 51, 0});
}

TEST_CASE("colmap: images whose aspect ratio differs from their cameras are rejected", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  put_image(folder / "images/im3.png", 48, 64, 3);
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("im3.png") && Contains("48x64") &&
                                                                   Contains("64x48") &&
                                                                   Contains("rotated by 90 degrees"));
  put_image(folder / "images/im3.png", 60, 40, 3);
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("different aspect ratio"));
  for (const auto& [width, height] :
       {std::pair{32, 24}, std::pair{21, 16}, std::pair{22, 16}, std::pair{640, 479}}) {
    put_image(folder / "images/im3.png", width, height, 3);
    CHECK_NOTHROW(load_dataset(folder.path()));
  }
}

TEST_CASE("colmap: the scale, principal point, split and image folder can be chosen", "[colmap]") {
  TempFolder folder;
  put_scene(folder);
  DatasetOptions options;
  options.read.downscale = 2;
  options.read.principal_point = PrincipalPoint::centre;
  options.read.test_every = 0;
  Dataset data = load_dataset(folder.path(), options);
  CHECK(data.splits.size() == 1);
  Camera camera = data.splits[0].views[0].camera;
  CHECK(std::array{camera.width, camera.height} == std::array{32, 24});
  CHECK(std::array{camera.fx, camera.fy, camera.cx, camera.cy} == std::array{25.0, 25.5, 16.0, 12.0});
  CHECK(data.splits[0].views[0].image.width == 32);

  // Reduced images of a folder are used unchanged, not scaled up to the size of the cameras.
  for (int i = 0; i < 10; ++i) put_image(folder / fmt::format("images_4/im{}.png", i), 16, 12, i);
  options = {};
  options.read.test_every = 8;
  options.read.images = "images_4";
  data = load_dataset(folder.path(), options);
  camera = data.find("train")->views[0].camera;
  CHECK(camera.width == 16);
  CHECK(camera.fx == Approx(12.5));
  CHECK(camera.cx == Approx(33.0 / 4));
  REQUIRE(data.report.notes.size() == 3);
  CHECK_THAT(data.report.notes[2], Contains("ratio 4.000"));
}

TEST_CASE("colmap: missing images are skipped and reported", "[colmap]") {
  TempFolder folder;
  put_scene(folder);
  std::filesystem::remove(folder / "images/im4.png");
  const Dataset data = load_dataset(folder.path());
  CHECK(data.splits[0].views.size() + data.splits[1].views.size() == 9);
  REQUIRE(data.report.skipped.size() == 1);
  CHECK(data.report.skipped[0].examples == std::vector<std::string>{"im4.png"});
}

TEST_CASE("colmap: distorted images are undistorted, which is reported", "[colmap]") {
  TempFolder folder;
  put_scene(folder, 2);
  const Dataset data = load_dataset(folder.path());
  const View& view = data.find("train")->views[0];
  CHECK(view.camera.fx == 50);
  CHECK(view.image.width == view.camera.width);
  CHECK(view.camera.width < 64);  // the lens has pincushion distortion, so the undistorted image is smaller
  CHECK(std::ranges::any_of(data.report.notes,
                            [](const std::string& n) { return n.find("undistorted") != n.npos; }));
  DatasetOptions options;
  options.read.cache_folder = (folder / "cache").string();
  const Dataset first = load_dataset(folder.path(), options), second = load_dataset(folder.path(), options);
  CHECK(file_count(folder / "cache") == 10);
  CHECK(second.splits[0].views[1].image.rgb == data.splits[0].views[1].image.rgb);
  CHECK(first.splits[0].views[1].image.rgb == data.splits[0].views[1].image.rgb);
  // Earlier versions printed a line for each of many lenses.
  std::string cameras, images;
  for (int i = 0; i < 10; ++i) {
    cameras += fmt::format("{} SIMPLE_RADIAL 64 48 50 32 24 {}\n", i, 0.1 + 0.01 * i);
    images += fmt::format("{} 1 0 0 0 {} 0 0 {} im{}.png\n\n", i, i, i, i);
  }
  put(folder / "sparse/0/cameras.txt", cameras);
  put(folder / "sparse/0/images.txt", images);
  const std::vector<std::string> notes = load_dataset(folder.path(), {.load_images = false}).report.notes;
  const auto named = [&](const char* part) {
    return std::ranges::count_if(notes, [&](const std::string& n) { return n.find(part) != n.npos; });
  };
  CHECK(named("undistorted") == 2);
  CHECK(named("focal length, the smallest") == 1);
}

TEST_CASE("colmap: masked pixels are ignored", "[colmap]") {
  TempFolder folder;
  put_scene(folder);
  Image8 mask{64, 48, std::vector<std::uint8_t>(64 * 48 * 3, 255)};
  std::fill_n(mask.rgb.begin(), 64 * 3 * 10, std::uint8_t{0});  // the upper ten rows
  std::filesystem::create_directories(folder / "masks");
  save_png(folder / "masks/im3.png.png", mask);
  const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 8}});
  const View& view = data.find("train")->views[2];
  CHECK(view.masked);
  CHECK(view.image.rgb == gradient_image(64, 48, 3).rgb);
  REQUIRE(view.image.mask.size() == 64 * 48);
  for (std::size_t i = 0; i < view.image.mask.size(); ++i)
    REQUIRE(int{view.image.mask[i]} == (i < 640 ? 0 : 255));
  CHECK(!data.find("train")->views[1].masked);
  CHECK(data.find("train")->views[1].image.mask.empty());

  DatasetOptions options;
  options.read.downscale = 2;
  options.read.test_every = 8;
  const Image8 half = load_dataset(folder.path(), options).find("train")->views[2].load_image();
  REQUIRE(half.mask.size() == 32 * 24);
  CHECK(half.mask[32 * 5 - 1] == 0);
  CHECK(half.mask[32 * 5] == 255);
}

TEST_CASE("colmap: in masks with the values 0 and 1, the value 1 means that a pixel is used", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  std::filesystem::create_directories(folder / "masks");
  const std::string file = (folder / "masks/im3.png").string();
  for (const int type : {CV_8UC1, CV_16UC1}) {
    cv::Mat mask(48, 64, type, cv::Scalar(1));
    mask.rowRange(0, 10).setTo(0);
    REQUIRE(cv::imwrite(file, mask));
    const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 0}});
    const Image8& image = data.find("train")->views.at(3).image;
    CHECK(std::ranges::count(image.mask, 255) == 38 * 64);
  }
}

TEST_CASE("colmap: a mask may have the name of its image with a different extension", "[colmap]") {
  const TempFolder folder;
  put(folder / "sparse/0/cameras.txt", kCameras);
  put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a/im.jpg\n\n2 1 0 0 0 1 0 0 1 b/im.jpg\n\n");
  for (const char* name : {"images/a/im.jpg", "images/b/im.jpg"}) {
    std::filesystem::create_directories((folder / name).parent_path());
    REQUIRE(cv::imwrite((folder / name).string(), cv::Mat(48, 64, CV_8UC3, cv::Scalar(9, 9, 9))));
  }
  std::filesystem::create_directories(folder / "masks/b");
  REQUIRE(cv::imwrite((folder / "masks/b/im.png").string(), cv::Mat(48, 64, CV_8UC1, cv::Scalar(0))));
  const auto masked = [&] {
    const std::vector<View> views =
        load_dataset(folder.path(), {.read = {.test_every = 0}}).find("train")->views;
    return std::array{views[0].image.mask, views[1].image.mask};
  };
  CHECK(masked()[0].empty());
  CHECK(masked()[1] == std::vector<std::uint8_t>(64 * 48, 0));
  REQUIRE(cv::imwrite((folder / "masks/b/im.jpg.png").string(), cv::Mat(48, 64, CV_8UC1, cv::Scalar(255))));
  CHECK(masked()[1] == std::vector<std::uint8_t>(64 * 48, 255));  // COLMAP's own naming takes precedence
}

TEST_CASE("colmap: an image with a name that leads out of the folder is not used as its own mask",
          "[colmap]") {
  const TempFolder folder;
  put(folder / "sparse/0/cameras.txt", kCameras);
  put_image(folder / "images/im.png", 64, 48);
  std::filesystem::create_directories(folder / "masks");
  for (const std::string& name : {std::string("../images/im.png"), (folder / "images/im.png").string()}) {
    put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 " + name + "\n\n");
    CHECK(!load_dataset(folder.path(), {.read = {.test_every = 0}}).find("train")->views.at(0).masked);
  }
}

TEST_CASE("colmap: masks of full images are applied to reduced images", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  for (int i = 0; i < 10; ++i) put_image(folder / fmt::format("images_2/im{}.png", i), 32, 24, i);
  std::filesystem::create_directories(folder / "masks");
  cv::Mat mask(48, 64, CV_8UC1, cv::Scalar(255));
  mask.rowRange(0, 24).setTo(0);
  REQUIRE(cv::imwrite((folder / "masks/im3.png").string(), mask));
  DatasetOptions options;
  options.read.images = "images_2";
  options.read.test_every = 8;
  std::vector<std::uint8_t> expected(32 * 24, 255);
  std::fill_n(expected.begin(), 32 * 12, std::uint8_t{0});
  CHECK(load_dataset(folder.path(), options).find("train")->views[2].image.mask == expected);
  REQUIRE(cv::imwrite((folder / "masks/im3.png").string(), cv::Mat(64, 48, CV_8UC1, cv::Scalar(255))));
  CHECK_THAT(message_of([&] { load_dataset(folder.path(), options); }),
             Contains("the mask has 48x64 pixels"));
}

TEST_CASE("colmap: masks may have colours and a meaningful alpha channel", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  std::filesystem::create_directories(folder / "masks");
  // The upper half of each mask is black or transparent. Channels are in the order blue, green, red, alpha.
  const auto masked = [&](const cv::Mat& upper, const cv::Mat& lower) {
    cv::Mat mask;
    cv::vconcat(upper, lower, mask);
    REQUIRE(cv::imwrite((folder / "masks/im3.png").string(), mask));
    return load_dataset(folder.path(), {.read = {.test_every = 8}}).find("train")->views[2].image.mask;
  };
  const auto half = [](int type, const cv::Scalar& colour) { return cv::Mat(24, 64, type, colour); };
  std::vector<std::uint8_t> expected(64 * 48, 255);
  std::fill_n(expected.begin(), 64 * 24, std::uint8_t{0});
  CHECK(masked(half(CV_8UC4, {0, 0, 0, 255}), half(CV_8UC4, {255, 255, 255, 255})) == expected);
  CHECK(masked(half(CV_8UC4, {9, 9, 9, 0}), half(CV_8UC4, {9, 9, 9, 255})) == expected);
  CHECK(masked(half(CV_8UC3, {0, 0, 0}), half(CV_8UC3, {0, 0, 255})) == expected);
  CHECK(masked(half(CV_16UC4, {0, 0, 0, 65535}), half(CV_16UC4, {0, 65535, 0, 65535})) == expected);
}

TEST_CASE("colmap: an image with alpha is not opaque", "[colmap]") {
  const TempFolder folder;
  put_scene(folder);
  REQUIRE(
      cv::imwrite((folder / "images/im1.png").string(), cv::Mat(48, 64, CV_8UC4, cv::Scalar(9, 9, 9, 99))));
  REQUIRE(cv::imwrite((folder / "images/im2.png").string(), cv::Mat(48, 64, CV_8UC1, cv::Scalar(9))));
  const std::vector<View> views =
      load_dataset(folder.path(), {.read = {.test_every = 8}}).find("train")->views;
  REQUIRE(views[0].name == "im1");
  CHECK_FALSE(views[0].opaque);
  for (std::size_t i = 1; i < views.size(); ++i) CHECK(views[i].opaque);
}

// All views of a wide image must be in the same split. As for other images, the split depends on the name of
// the image. The views must have different names.
TEST_CASE("colmap: wide images become several views", "[colmap]") {
  TempFolder folder;
  put_scene(folder);
  put(folder / "sparse/0/cameras.txt", "1 EQUIRECTANGULAR 64 48 64 48\n");
  const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 8}});
  CHECK(data.find("train")->views.size() == 8 * 6);
  REQUIRE(data.find("test")->views.size() == 2 * 6);  // im0 and im8
  CHECK(data.find("test")->views[0].name == "im0_back");
  CHECK(data.find("test")->views[11].name == "im8_up");
  std::set<std::string> names;
  for (const Split& split : data.splits)
    for (const View& view : split.views) {
      names.insert(view.name);
      CHECK(view.name.starts_with(view.part_of + "_"));
      CHECK((view.part_of == "im0" || view.part_of == "im8") == (split.name == "test"));
      CHECK(view.image.width == view.camera.width);
      CHECK(view.camera.fx == view.camera.width / 2.0);
      CHECK(view.camera.centre()[0] == Approx(-(view.part_of[2] - '0')).margin(1e-12));  // t = (i, 0, 0)
      CHECK_FALSE(view.masked);
    }
  CHECK(names.size() == 60);
  CHECK(std::ranges::count(data.report.differences,
                           "10 wide images were split into 60 pinhole views of at most 90 degrees") == 1);
  // A fisheye image does not cover all pixels of its outer views, so these pixels are masked. Views that are
  // read from the cache folder must have the same pixels.
  put(folder / "sparse/0/cameras.txt", "1 FISHEYE 64 48 16 16 32 24\n");
  const TempFolder cache;
  DatasetOptions options;
  options.read.cache_folder = cache.path();
  const Dataset first = load_dataset(folder.path(), options), again = load_dataset(folder.path(), options);
  std::size_t masked = 0;
  for (std::size_t i = 0; i < first.splits[0].views.size(); ++i) {
    const View &a = first.splits[0].views[i], &b = again.splits[0].views[i];
    CHECK(a.image.rgb == b.image.rgb);
    CHECK(a.image.mask == b.image.mask);
    CHECK(a.image.mask.empty() != a.masked);
    if (!a.masked) continue;
    ++masked;
    const auto excluded = std::ranges::count(a.image.mask, 0);
    CHECK(excluded > 0);
    CHECK(excluded < std::ssize(a.image.mask));
  }
  CHECK(masked > 0);
}

// If a mask excludes all pixels of a view, the view is dropped, because it has no pixel for metrics.
TEST_CASE("colmap: the mask of a wide image is applied to its views", "[colmap]") {
  TempFolder folder;
  put_scene(folder);
  put(folder / "sparse/0/cameras.txt", "1 EQUIRECTANGULAR 64 48 64 48\n");
  cv::Mat mask(48, 64, CV_8U, cv::Scalar(255));
  mask.rowRange(30, 48) = 0;  // from 22 degrees below the horizon, where the tripod is
  std::filesystem::create_directories(folder / "masks");
  cv::imwrite((folder / "masks/im3.png").string(), mask);
  const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 8}});
  CHECK(data.find("train")->views.size() == 8 * 6 - 1);
  for (const View& view : data.find("train")->views) {
    CHECK(view.name != "im3_down");
    CHECK(view.masked == (view.part_of == "im3"));
  }
}

TEST_CASE("colmap: every camera model of binary files is read", "[colmap]") {
  TempFolder folder;
  const int counts[] = {3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12, 16, 4, 5, 3, 4, 6, 2};
  const std::set<int> one_focal{0, 2, 3, 8, 9, 12, 14};
  for (int model = 0; model < 18; ++model) {
    std::vector<double> p{200};
    if (!one_focal.contains(model)) p.push_back(201);
    if (model == 17)
      p = {200 * 2 * std::acos(-1.0), 240};
    else
      p.insert(p.end(), {160, 120});
    while (static_cast<int>(p.size()) < counts[model]) p.push_back(0.01);
    put(folder / "sparse/0/cameras.bin", binary_camera(model, p));
    put(folder / "sparse/0/images.bin", binary_image("a/b.jpg", 2));
    const ColmapModel read = read_colmap_model(folder / "sparse/0");
    const Lens& lens = read.cameras.at(7).lens;
    INFO(read.cameras.at(7).model);
    CHECK(lens.fx == Approx(200));
    if (model != 17) CHECK(lens.cx == 160);
    CHECK(lens.cy == 120);
    CHECK(lens.distorted() == (model > 1));
    CHECK(read.images.at(0).name == "a/b.jpg");
    CHECK(read.images[0].translation == std::array<double, 3>{1, 2, 3});
  }
  put(folder / "sparse/0/cameras.bin", binary_camera(99, {1}));
  CHECK_THAT(message_of([&] { read_colmap_model(folder / "sparse/0"); }),
             Contains("model number 99") && Contains("16 EUCM, 17 EQUIRECTANGULAR"));
}

TEST_CASE("colmap: errors of damaged files contain the line or byte", "[colmap]") {
  TempFolder folder;
  put_scene(folder);
  const auto message = [&] { return message_of([&] { read_colmap_model(folder / "sparse/0"); }); };
  put(folder / "sparse/0/points3D.txt", "1 0 0 0 1 2 3 0\n2 1e300 0 0 1 2 3 0\n");
  CHECK_THAT(message(), Contains("points3D.txt:2: point 1 = 1e+300"));
  put(folder / "sparse/0/points3D.txt", "1 0 0 0 1 2 300 0\n");
  CHECK_THAT(message(), Contains("points3D.txt:1: colour '300'"));
  put(folder / "sparse/0/points3D.txt", kPoints);
  put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 inf 1 a.png\n\n");
  CHECK(read_colmap_model(folder / "sparse/0").unplaced == std::vector<std::string>{"a.png"});
  put(folder / "sparse/0/images.txt", "1 0 0 0 0 0 0 0 1 a.png\n\n");
  CHECK_THAT(message(), Contains("not a valid quaternion"));
  put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 9 a.png\n\n");
  CHECK_THAT(message(), Contains("camera 9 of image 'a.png' does not exist"));
  for (const char* bad : {"1e400", "x"}) {
    put(folder / "sparse/0/cameras.txt", fmt::format("1 PINHOLE 64 48 {} 50 32 24\n", bad));
    CHECK_THAT(message(), Contains("cameras.txt:1: "));
  }
  for (const char* bad : {"nan(ind)", "inf", "-nan"}) {
    put(folder / "sparse/0/cameras.txt",
        fmt::format("1 PINHOLE 64 48 {} 50 32 24\n9 PINHOLE 64 48 50 50 32 24\n", bad));
    put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 0 0 0 9 b.png\n\n");
    CHECK(read_colmap_model(folder / "sparse/0").unplaced == std::vector<std::string>{"a.png"});
    CHECK(read_colmap_model(folder / "sparse/0").images.size() == 1);
  }
  put(folder / "sparse/0/cameras.txt", "1 PINHOLE 64 48 50\n");
  CHECK_THAT(message(), Contains("cameras.txt:1: model PINHOLE has 4 parameters (fx fy cx cy), found 1"));
  put(folder / "sparse/0/cameras.txt", "1 MAGIC 64 48 50\n");
  CHECK_THAT(message(), Contains("'MAGIC' is not known") && Contains("12 SIMPLE_DIVISION"));

  std::string huge;
  add<std::uint64_t>(huge, ~0ull);
  put(folder / "sparse/0/cameras.bin", huge);
  CHECK_THAT(message(), Contains("the number of cameras at byte 0 is"));
  const std::string camera = binary_camera(1, {200, 200, 160, 120});
  put(folder / "sparse/0/cameras.bin", camera.substr(0, camera.size() - 1));
  CHECK_THAT(message(), Contains("truncated"));
  put(folder / "sparse/0/cameras.bin", camera);
  put(folder / "sparse/0/images.bin", binary_image("a.png", 1).substr(0, 90));
  CHECK_THAT(message(), Contains("images.bin"));
}

TEST_CASE("colmap: real scenes are loaded", "[colmap][data]") {
  struct Scene {
    const char* name;
    std::size_t train, test, points;
    int width, height;
  };
  const auto check = [](const Scene& scene) {
    UBS_REQUIRE_DATA(folder, scene.name);
    DatasetOptions options;
    options.image_splits = {"test"};
    const Dataset data = load_dataset(folder, options);
    INFO(scene.name);
    CHECK(data.report.layout == "colmap");
    CHECK(data.report.skipped.empty());
    CHECK(data.find("train")->views.size() == scene.train);
    CHECK(data.find("test")->views.size() == scene.test);
    CHECK(data.points->positions.size() == scene.points);
    for (const View& view : data.find("test")->views) {
      CHECK(view.image.width == scene.width);
      CHECK(view.image.height == scene.height);
    }
    CHECK_FALSE(data.find("train")->views[0].has_image());

    // At least 30 % of the points must be in front of the second test camera and inside its image.
    std::size_t inside = 0, all = 0;
    const Camera& c = data.find("test")->views[1].camera;
    for (const auto& p : data.points->positions) {
      double q[3];
      for (std::size_t r = 0; r < 3; ++r)
        q[r] = c.rotation[3 * r] * p[0] + c.rotation[3 * r + 1] * p[1] + c.rotation[3 * r + 2] * p[2] +
               c.translation[r];
      const double u = c.fx * q[0] / q[2] + c.cx, v = c.fy * q[1] / q[2] + c.cy;
      inside += q[2] > 0 && u > 0 && u < c.width && v > 0 && v < c.height;
      ++all;
    }
    CHECK(static_cast<double>(inside) > 0.3 * static_cast<double>(all));
  };
  for (const Scene& scene :
       {Scene{"colmap_cup_800", 67, 10, 9262, 800, 600}, Scene{"mip360_bonsai_800", 255, 37, 49602, 800, 533},
        Scene{"llff_fern_504", 17, 3, 10091, 504, 378}})
    check(scene);
}
