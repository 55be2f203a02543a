// SPDX-License-Identifier: Apache-2.0
// Tests the synthetic data sets: they can be loaded like other folders, are reproducible, and depend on view
// and time. Writing them must not overwrite files of the user.
#include "host/dataset/synthetic.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "host/dataset/blender.hpp"
#include "host/dataset/image.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

SyntheticOptions small(const std::string& scene, std::uint64_t seed = 0) {
  SyntheticOptions options;
  options.scene = scene;
  options.width = 40;
  options.height = 30;
  options.train_views = 6;
  options.test_views = 3;
  options.supersampling = 2;
  options.seed = seed;
  return options;
}

std::map<std::string, std::string> contents(const std::filesystem::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) files[entry.path().lexically_relative(folder).string()] = get(entry.path());
  return files;
}

// Returns the alpha of a written image, computed from its pixels in front of white and of black.
std::vector<int> alpha_of(const std::filesystem::path& png) {
  const Image8 black = load_image(png), white = load_image(png, {1, 1, 1});
  std::vector<int> alpha;
  for (std::size_t i = 0; i < black.rgb.size(); i += 3) alpha.push_back(255 - (white.rgb[i] - black.rgb[i]));
  return alpha;
}

}  // namespace

TEST_CASE("synthetic: every scene is an ordinary data set", "[synthetic]") {
  TempFolder folder;
  const std::string scene = GENERATE(as<std::string>(), "glossy", "orbit", "cloud");
  CAPTURE(scene);
  export_synthetic(small(scene), folder.path());
  CHECK(file_count(folder.path()) == 4);  // two JSON files, two image folders
  const Split train = load_blender_split(folder.path(), "train"),
              test = load_blender_split(folder.path(), "test");
  CHECK_FALSE(has_blender_split(folder.path(), "val"));
  REQUIRE(train.views.size() == 6);
  REQUIRE(test.views.size() == 3);
  for (const Split* split : {&train, &test})
    for (const View& view : split->views) {
      CHECK(std::array{view.camera.width, view.camera.height} == std::array{40, 30});
      CHECK(view.camera.fx == Approx(20 / std::tan(0.6911112 / 2)));
      CHECK(view.camera.centre()[2] > 0);
      const auto centre = view.camera.centre();
      CHECK(std::hypot(centre[0], centre[1], centre[2] + (scene == "cloud" ? 0.0 : 0.3)) ==
            Approx(4.0311289));
      const auto& rgb = view.image.rgb;
      CHECK(std::count(rgb.begin(), rgb.end(), 0) > 100);      // part of the image is black background
      CHECK(*std::max_element(rgb.begin(), rgb.end()) > 100);  // part of the image is bright
      CHECK(std::count_if(rgb.begin(), rgb.end(), [](int v) { return v > 10; }) > 300);
    }
  for (const View& a : train.views)
    for (const View& b : test.views) {
      const auto p = a.camera.centre(), q = b.camera.centre();
      CHECK(std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]) > 0.01);
    }
}

TEST_CASE("synthetic: equal seeds give equal bytes, and different seeds different views", "[synthetic]") {
  TempFolder folder;
  export_synthetic(small("cloud", 5), folder / "a");
  export_synthetic(small("cloud", 5), folder / "b");
  export_synthetic(small("cloud", 6), folder / "c");
  CHECK(contents(folder / "a") == contents(folder / "b"));
  CHECK(contents(folder / "a").at("train/r_000.png") != contents(folder / "c").at("train/r_000.png"));
}

TEST_CASE("synthetic: the pixels agree with the cameras", "[synthetic]") {
  TempFolder folder;
  SyntheticOptions options = small("orbit");
  options.width = options.height = 60;
  export_synthetic(options, folder.path());
  // The slab has a half width of 0.98, and its upper side is at height -0.62. Alpha must be 1 well inside of
  // its corners, and 0 in front of and below the edges that face the camera.
  int inside_count = 0, outside_count = 0;
  for (const View& view : load_blender_split(folder.path(), "train").views) {
    if (view.camera.centre()[2] < 1.2)
      continue;  // at such a flat angle, every point is about a pixel from the border
    const auto alpha = alpha_of(folder / ("train/" + view.name + ".png"));
    const auto alpha_at = [&](double x, double y, double z) {
      const Camera& c = view.camera;
      std::array<double, 3> p{};
      for (std::size_t r = 0; r < 3; ++r)
        p[r] =
            c.rotation[3 * r] * x + c.rotation[3 * r + 1] * y + c.rotation[3 * r + 2] * z + c.translation[r];
      const int px = static_cast<int>(c.fx * p[0] / p[2] + c.cx),
                py = static_cast<int>(c.fy * p[1] / p[2] + c.cy);
      if (px < 0 || py < 0 || px >= 60 || py >= 60) return -1;
      return alpha[static_cast<std::size_t>(60 * py + px)];
    };
    for (const double sx : {-1.0, 1.0})
      for (const double sy : {-1.0, 1.0}) {
        const int inside = alpha_at(0.85 * sx, 0.85 * sy, -0.62);
        if (inside >= 0) {
          CHECK(inside == 255);
          ++inside_count;
        }
      }
    const auto centre = view.camera.centre();
    for (const double side : {-1.0, 1.0})
      for (const std::size_t axis : {0u, 1u}) {
        if (centre[axis] * side < 0.8) continue;  // only edges that face the camera
        const int outside = axis == 0 ? alpha_at(1.12 * side, 0, -0.75) : alpha_at(0, 1.12 * side, -0.75);
        if (outside < 0) continue;
        CHECK(outside == 0);
        ++outside_count;
      }
  }
  CHECK(inside_count >= 12);
  CHECK(outside_count >= 2);
}

TEST_CASE("synthetic: few pixels of solid objects are partly transparent, but many of the cloud",
          "[synthetic]") {
  TempFolder folder;
  export_synthetic(small("glossy"), folder / "g");
  export_synthetic(small("cloud"), folder / "c");
  const auto partial = [](const std::vector<int>& alpha) {
    return std::count_if(alpha.begin(), alpha.end(), [](int a) { return a > 3 && a < 252; });
  };
  CHECK(partial(alpha_of(folder / "g/train/r_000.png")) < 110);  // observed: 55, on the outline
  CHECK(partial(alpha_of(folder / "c/train/r_000.png")) > 130);  // observed: 255 of 1200
}

TEST_CASE("synthetic: orbit covers the whole time range and moves", "[synthetic]") {
  TempFolder folder;
  export_synthetic(small("orbit"), folder.path());
  const Split train = load_blender_split(folder.path(), "train"),
              test = load_blender_split(folder.path(), "test");
  for (std::size_t i = 0; i < 6; ++i) CHECK(train.views[i].camera.time == Approx(static_cast<double>(i) / 5));
  CHECK(test.views[0].camera.time == Approx(1.0 / 6));
  CHECK(test.views[2].camera.time == Approx(5.0 / 6));
  CHECK_THAT(get(folder / "transforms_train.json"), Contains("\"time\""));
  export_synthetic(small("glossy"), folder / "static");
  CHECK_THAT(get(folder / "static/transforms_train.json"), !Contains("\"time\""));
}

TEST_CASE("synthetic: only --overwrite replaces files, and only those with the names of new files",
          "[synthetic]") {
  TempFolder folder;
  export_synthetic(small("orbit"), folder / "a");
  put(folder / "a/train/notes.txt", "mine");
  const auto before = contents(folder / "a");
  SyntheticOptions options = small("glossy");
  options.train_views = 2;
  options.test_views = 0;
  options.val_views = 1;
  const auto said = [&](const char* out) {
    return message_of([&] { export_synthetic(options, folder / out); }, ErrorKind::usage);
  };
  CHECK_THAT(said("a"), Contains("a/transforms_train.json: already exists") && Contains("--overwrite"));
  CHECK(contents(folder / "a") == before);
  options.overwrite = true;
  export_synthetic(options, folder / "a");
  CHECK(get(folder / "a/train/notes.txt") == "mine");
  CHECK(get(folder / "a/train/r_000.png") != before.at("train/r_000.png"));
  CHECK(get(folder / "a/train/r_003.png") == before.at("train/r_003.png"));
  CHECK_FALSE(std::filesystem::exists(folder / "a/transforms_test.json"));
  CHECK(load_blender_split(folder / "a", "train").views.size() == 2);
  CHECK(load_blender_split(folder / "a", "val").views.size() == 1);

  options.overwrite = false;
  put(folder / "b/train/r_001.png", "precious");
  CHECK_THAT(said("b"), Contains("b/train/r_001.png: already exists"));
  CHECK(get(folder / "b/train/r_001.png") == "precious");
  put(folder / "file", "x");
  CHECK_THAT(said("file"), Contains("is not a folder"));
}

TEST_CASE("synthetic: options are checked before anything is written", "[synthetic]") {
  TempFolder folder;
  const auto refusal = [&](const SyntheticOptions& options) {
    return message_of([&] { export_synthetic(options, folder / "x"); }, ErrorKind::usage);
  };
  SyntheticOptions options = small("nothing");
  CHECK_THAT(refusal(options), Contains("choose one of glossy, orbit, cloud"));
  options = small("glossy");
  options.width = 0;
  CHECK_THAT(refusal(options), Contains("width = 0"));
  options = small("glossy");
  options.train_views = 0;
  CHECK_THAT(refusal(options), Contains("train_views = 0"));
  options = small("glossy");
  options.supersampling = 17;
  CHECK_THAT(refusal(options), Contains("supersampling = 17"));
  CHECK_FALSE(std::filesystem::exists(folder / "x"));
}
