// SPDX-License-Identifier: Apache-2.0
// Compares the views of data folders that tests/data/layouts_test.py writes in the forms of photogrammetry
// programs with the analytic scene. That script runs the hidden test; the other tests write their own files.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <string>

#include "host/base/paths.hpp"
#include "host/dataset/load_dataset.hpp"
#include "tests/support/images.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using test::message_of;
using test::put;
using test::TempFolder;

constexpr double kRadius = 4;

// The colour of a point of the sphere, as in layouts_test.py.
std::array<double, 3> colour_of(const std::array<double, 3>& p) {
  const double x = p[0] / kRadius, y = p[1] / kRadius, z = p[2] / kRadius;
  return {0.5 + 0.4 * std::sin(5 * x + 1), 0.5 + 0.4 * std::sin(6 * y + 2 * x),
          0.5 + 0.4 * std::cos(5 * z - y)};
}

// Returns the PSNR of the image of a view against the scene.
double psnr_of(const View& view) {
  const Image8 image = view.load_image();
  const Camera& camera = view.camera;
  const std::array<double, 3> o = camera.centre();
  double sum = 0;
  std::size_t count = 0;
  for (int row = 0; row < image.height; ++row)
    for (int column = 0; column < image.width; ++column) {
      const auto pixel = static_cast<std::size_t>(row * image.width + column);
      if (!image.mask.empty() && image.mask[pixel] == 0) continue;
      const std::array<double, 3> d = camera.ray(column + 0.5, row + 0.5);
      const double a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2], b = d[0] * o[0] + d[1] * o[1] + d[2] * o[2];
      const double c = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - kRadius * kRadius;
      const double t = (-b + std::sqrt(b * b - a * c)) / a;
      const std::array<double, 3> truth = colour_of({o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]});
      for (std::size_t k = 0; k < 3; ++k, ++count) {
        const double error = image.rgb[3 * pixel + k] / 255.0 - truth[k];
        sum += error * error;
      }
    }
  return 10 * std::log10(static_cast<double>(count) / sum);
}

}  // namespace

// The smallest PSNR that was observed is 54.7 dB. If the principal point is wrong by half a pixel, it is 42
// to 44 dB.
TEST_CASE("layouts: the scene is read in the forms of other programs", "[.layouts]") {
  const char* folder = std::getenv("UBS_LAYOUTS");
  REQUIRE(folder);
  std::set<std::string> layouts;
  for (const fs::path& path : folder_entries(folder)) {
    const std::string name = path.filename().string();
    INFO(name);
    const Dataset data = load_dataset(path, {.read = {.test_every = 0}});
    layouts.insert(data.report.layout);
    CHECK(name.starts_with(data.report.layout));
    REQUIRE(data.splits.size() == 1);
    CHECK(data.splits[0].views.size() == 4);
    for (const View& view : data.splits[0].views) {
      INFO(view.name);
      const double psnr = psnr_of(view);
      CHECK(psnr > 50);
    }
    const bool points = data.report.layout == "opensfm" || data.report.layout == "bundler";
    REQUIRE(data.points.has_value() == points);
    if (points) {
      REQUIRE(data.points->positions.size() == 1);
      CHECK(data.points->positions[0] == std::array<float, 3>{1, 2, 3});
    }
    if (name == "metashape-frame") CHECK(data.report.skipped.size() == 2);
  }
  CHECK(layouts == std::set<std::string>{"bundler", "metashape", "nerfstudio", "opensfm", "polycam",
                                         "realitycapture", "record3d"});
}

TEST_CASE("layouts: errors in the cameras of other programs name the file, the place and the reason",
          "[dataset]") {
  const auto refusal = [](const std::string& file, const std::string& contents) {
    const TempFolder folder;
    test::put_image(folder / "images/a.png", 8, 6);
    put(folder / "list.txt", "a.png\n");
    put(folder / file, contents);
    return message_of([&] { load_dataset(folder.path()); });
  };
  const auto metashape = [&](const std::string& calibration, const std::string& camera) {
    return refusal("m.xml", R"(<document><chunk label="c"><sensors><sensor id="0" label="s">)"
                            R"(<resolution width="8" height="6"/>)" +
                                calibration + "</sensor></sensors><cameras>" + camera +
                                "</cameras></chunk></document>");
  };
  const std::string camera =
      R"(<camera label="a" sensor_id="0"><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>)";
  CHECK_THAT(refusal("m.xml", "<document><chunk>"), Contains("m.xml: malformed XML at byte"));
  CHECK_THAT(metashape("", R"(<camera label="a" sensor_id="0"/>)"), Contains("no chunk has aligned cameras"));
  CHECK_THAT(metashape("", camera), Contains("no calibration with a focal length"));
  CHECK_THAT(metashape(R"(<calibration type="rpc"/>)", camera), Contains("lens type 'rpc' is not supported"));
  CHECK_THAT(metashape("<calibration><f>9</f><p3>1</p3></calibration>", camera), Contains("coefficient p3"));
  CHECK_THAT(metashape("<calibration><f>nan</f></calibration>", camera),
             Contains("sensor 0 (s): f is not finite"));
  CHECK_THAT(metashape("<calibration><f>9</f></calibration>", R"(<camera label="a" sensor_id="5">)"
                                                              "<transform>1</transform></camera>"),
             Contains("camera 'a': there is no sensor with the number '5'"));
  const std::string head = "#name,x,y,alt,heading,pitch,roll,f\n";
  CHECK_THAT(refusal("r.csv", head + "a.png,1,2\n"), Contains("r.csv:2: expected 8 values, found 3"));
  CHECK_THAT(refusal("r.csv", head + "a.png,1,2,3,4,5,6,x\n"), Contains("r.csv:2: f: 'x' is not a number"));
  CHECK_THAT(refusal("r.csv", "#name,x,y,heading,pitch,roll,f\n"), Contains("column 'alt' is missing"));
  std::string utf16 = "\xff\xfe";
  for (const char c : head) utf16 += c, utf16 += '\0';
  CHECK_THAT(refusal("r.csv", utf16), Contains("UTF-16: save it as UTF-8"));
  const auto xmp = [&](const std::string& attributes) {
    return refusal("images/a.xmp", "<x><d xcr:Rotation=\"1 0 0 0 1 0 0 0 1\" " + attributes + "/></x>");
  };
  CHECK_THAT(xmp(""), Contains("its XMP file has no pose"));
  CHECK_THAT(xmp(R"(xcr:Position="0 0 0" xcr:DistortionModel="division")"), Contains("'division'"));
  CHECK_THAT(xmp(R"(xcr:Position="0 0 0")"), Contains("focal length must be positive"));
  const auto opensfm = [&](const std::string& lens) {
    return refusal(
        "reconstruction.json",
        R"([{"cameras": {"c": {"width": 8, "height": 6, )" + lens +
            R"(}}, "shots": {"a.png": {"camera": "c", "rotation": [0,0,0], "translation": [0,0,0]}}}])");
  };
  CHECK_THAT(opensfm(R"("projection_type": "dual")"), Contains("camera 'c': the projection 'dual'"));
  CHECK_THAT(opensfm(R"("projection_type": "brown", "focal_x": 0)"),
             Contains("focal length must be positive"));
  CHECK_THAT(refusal("bundle.out", "# Bundle file v0.3\n1 0\n9 0 0\n1 0 0\n"),
             Contains("bundle.out: ends after line 4"));
  CHECK_THAT(refusal("bundle.out", "# Bundle file v0.3\n2 0\n"),
             Contains("2 cameras") && Contains("1 images"));
  CHECK_THAT(refusal("keyframes/cameras/a.json", R"({"t_00": 1, "width": 8, "height": 6})"),
             Contains("a.json: '") && Contains("' is missing"));
  CHECK_THAT(refusal("metadata", R"({"w": 8, "h": 6, "K": [1], "poses": [[1]]})"),
             Contains("'K': must be 9 numbers"));
}

}  // namespace ubs
