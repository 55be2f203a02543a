// SPDX-License-Identifier: Apache-2.0
// Compares camera models with pycolmap, with OpenCV and with their own inverse. Also compares undistorted
// images with images of an ideal camera.
#include <algorithm>
#include <cstdlib>
#include <opencv2/calib3d.hpp>
#include <set>
#include <sstream>

#include "host/dataset/colmap.hpp"
#include "host/dataset/undistort.hpp"
#include "tests/support/images.hpp"

using namespace ubs;
using namespace ubs::test;

namespace {

Lens lens_of(std::string_view model, std::initializer_list<double> parameters, int width = 320,
             int height = 240) {
  const auto row = std::ranges::find(lens_models(), model, &LensModel::name);
  REQUIRE(row != lens_models().end());
  const std::vector<std::string_view> names = words_of(row->parameters);
  REQUIRE(names.size() == parameters.size());
  Lens lens{row->formula, 1, 1, 0, 0, width, height, {}};
  for (std::size_t i = 0; i < names.size(); ++i) REQUIRE(lens.set(names[i], parameters.begin()[i]));
  return lens;
}

const Lens& full_opencv() {
  static const Lens lens =
      lens_of("FULL_OPENCV", {210, 205, 161, 118, -0.15, 0.03, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001});
  return lens;
}

const Lens& opencv_fisheye() {
  static const Lens lens = lens_of("OPENCV_FISHEYE", {210, 205, 161, 118, 0.02, -0.01, 0.003, -0.001});
  return lens;
}

// Returns distorted lenses of different formulas.
std::vector<Lens> some_lenses() {
  return {full_opencv(),
          lens_of("SIMPLE_RADIAL", {210, 161, 118, 0.08}),
          opencv_fisheye(),
          lens_of("FOV", {210, 205, 161, 118, 0.7}),
          lens_of("THIN_PRISM_FISHEYE",
                  {210, 205, 161, 118, 0.02, -0.01, 0.001, -0.001, 0.002, 0.001, 0.003, -0.002}),
          lens_of("RAD_TAN_THIN_PRISM_FISHEYE", {210, 205, 161, 118, 0.02, -0.01, 0.002, 0.001, 0, 0, 0.001,
                                                 -0.001, 0.002, 0.001, -0.001, 0.0005}),
          lens_of("DIVISION", {210, 205, 161, 118, -0.1}),
          lens_of("EUCM", {210, 205, 161, 118, 0.6, 1.1})};
}

// Returns the angle between two rays of any length.
double angle_between(const Ray& a, const Ray& b) {
  const Ray cross{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  return std::atan2(std::hypot(cross[0], cross[1], cross[2]), a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
}

}  // namespace

// lens_values.txt was created with pycolmap by lens_values.py, which also runs this test with 1000 points of
// each model. The test also covers the order of COLMAP's parameters, because make_colmap_camera() gets the
// parameters in that order.
TEST_CASE("lens: every camera model agrees with pycolmap", "[lens]") {
  const char* own = std::getenv("UBS_LENS_VALUES");
  std::ifstream in(own ? own : UBS_SOURCE_DIR "/tests/data/lens_values.txt");
  Lens lens;
  std::string line, name;
  std::set<std::string> seen;
  std::size_t points = 0;
  double worst_pixel = 0, worst_angle = 0;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    if (kind == "lens") {
      int width = 0, height = 0;
      words >> name >> width >> height;
      std::vector<double> parameters;
      for (double value = 0; words >> value;) parameters.push_back(value);
      lens = make_colmap_camera(name, static_cast<std::uint64_t>(width), static_cast<std::uint64_t>(height),
                                parameters, "test")
                 .lens;
      seen.insert(name);
    } else if (kind == "ray") {
      Ray ray{};
      double column = 0, row = 0;
      words >> ray[0] >> ray[1] >> ray[2] >> column >> row;
      REQUIRE(words);
      INFO(line << " of " << name);
      const auto p = project_ray(lens, ray);
      REQUIRE(p);
      const auto back = pixel_ray(lens, column, row);
      REQUIRE(back);
      const double pixel_error = std::hypot((*p)[0] - column, (*p)[1] - row);
      const double angle_error = angle_between(*back, ray);
      // The largest errors at 1000 points of each model are 4.1e-13 px and 1.1e-13 rad (AMD EPYC).
      CHECK(pixel_error < 8e-13);
      CHECK(angle_error < 2e-13);
      worst_pixel = std::max(worst_pixel, pixel_error), worst_angle = std::max(worst_angle, angle_error);
      ++points;
    }
  }
  if (own)
    UNSCOPED_INFO("worst of " << points << " points: " << worst_pixel << " px, " << worst_angle << " rad");
  CHECK(points >= 300);
  std::size_t of_colmap = 0;
  for (const LensModel& model : lens_models())
    if (model.number >= 0) CHECK(model.number == static_cast<int>(of_colmap++));
  if (!own) CHECK(seen.size() == of_colmap);
}

// pycolmap does not project rays behind the camera with fisheye models, but the formulas are also valid
// there.
TEST_CASE("lens: fisheye models include rays behind the camera", "[lens]") {
  const Lens lens = lens_of("FISHEYE", {30, 20, 100, 90});
  const double angle = 110 * std::acos(-1.0) / 180;
  const auto p = project_ray(lens, {3 * std::sin(angle), 0, 3 * std::cos(angle)});
  REQUIRE(p);
  CHECK((*p)[0] == Approx(100 + 30 * angle));
  CHECK((*p)[1] == Approx(90));
  const auto back = pixel_ray(lens, 100, 90 - 20 * angle);
  REQUIRE(back);
  CHECK(angle_between(*back, {0, -std::sin(angle), std::cos(angle)}) < 1e-9);
  CHECK_FALSE(pixel_ray(lens, 100 + 30 * 3.2, 90));  // more than 180 degrees from the optical axis
  CHECK_FALSE(project_ray(lens, {0, 0, -1}));        // would be visible on the whole rim of the image
  CHECK_FALSE(project_ray(full_opencv(), {0.1, 0, -1}));
}

TEST_CASE("lens: distortion agrees with OpenCV", "[lens]") {
  const std::vector<cv::Point3d> rays{{0, 0, 1}, {0.3, -0.2, 1}, {-0.6, 0.5, 1}, {0.7, 0.55, 1}};
  const cv::Matx33d identity = cv::Matx33d::eye();
  const cv::Vec3d zero(0, 0, 0);
  std::vector<cv::Point2d> expected;
  const auto compare = [&](const Lens& lens) {
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const auto p = project_ray(lens, {rays[i].x, rays[i].y, rays[i].z});
      REQUIRE(p);
      CHECK((*p)[0] == Approx(lens.fx * expected[i].x + lens.cx).margin(1e-10));
      CHECK((*p)[1] == Approx(lens.fy * expected[i].y + lens.cy).margin(1e-10));
    }
  };
  const Lens& full = full_opencv();
  cv::projectPoints(rays, zero, zero, identity, std::vector<double>(full.k.begin(), full.k.begin() + 8),
                    expected);
  compare(full);
  const Lens& fisheye = opencv_fisheye();
  cv::fisheye::projectPoints(rays, expected, zero, zero, identity,
                             std::vector<double>(fisheye.k.begin(), fisheye.k.begin() + 4));
  compare(fisheye);
}

TEST_CASE("lens: solutions beyond the maximum of the polynomial are rejected", "[lens]") {
  // The maximum of r (1 - 0.9 r^2) is 0.406, at r = 0.61.
  const Lens lens = lens_of("SIMPLE_RADIAL", {100, 0, 0, -0.9});
  CHECK(pixel_ray(lens, 35, 0));
  CHECK_FALSE(pixel_ray(lens, 50, 0));
}

// The distorted image shows a known function of the ray. Undistorting it must restore this function.
TEST_CASE("lens: the undistorted image is that of an ideal camera", "[lens]") {
  const auto colour = [](double x, double y) { return 127 + 100 * std::sin(9 * x) * std::cos(7 * y); };
  for (const Lens& lens : some_lenses()) {
    Image8 seen{lens.width, lens.height, {}};
    for (int j = 0; j < lens.height; ++j)
      for (int i = 0; i < lens.width; ++i) {
        const auto ray = pixel_ray(lens, i + 0.5, j + 0.5);
        const double x = ray ? (*ray)[0] / (*ray)[2] : 0, y = ray ? (*ray)[1] / (*ray)[2] : 0;
        seen.rgb.insert(seen.rgb.end(), 3, static_cast<std::uint8_t>(colour(x, y) + 0.5));
      }
    const Undistortion plan = plan_undistortion(lens, "test");
    CHECK(plan.width > lens.width / 2);
    const Image8 ideal = undistort(seen, plan);
    REQUIRE(ideal.width == plan.width);
    double worst = 0;
    for (int j = 2; j < ideal.height - 2; ++j)
      for (int i = 2; i < ideal.width - 2; ++i) {
        const double expected = colour((i + 0.5 - plan.cx) / lens.fx, (j + 0.5 - plan.cy) / lens.fy);
        worst = std::max(worst,
                         std::abs(expected - ideal.rgb[3 * static_cast<std::size_t>(j * ideal.width + i)]));
      }
    // The error comes from rounding to 8 bits twice and from bicubic interpolation. An offset of half a pixel
    // would give 8 or more.
    CHECK(worst < 3.0);
  }
}

// The wide image shows a known function of the ray. The faces must restore this function in the world
// directions of their cameras, and mask the directions that the image does not cover. Less than 0.7 % of the
// pixels of the image may be outside of all faces.
TEST_CASE("lens: a wide image becomes faces of a cube", "[lens]") {
  const auto colour = [](const Ray& r) {
    const double n = std::hypot(r[0], r[1], r[2]);
    return 127 + 60 * std::sin(5 * r[0] / n) * std::cos(4 * r[1] / n) + 50 * std::sin(3 * r[2] / n + 1);
  };
  struct Case {
    Lens lens;
    std::size_t faces;
    int front_size;
    bool masked;
  };
  const double pi = std::acos(-1.0);
  const Case cases[] = {
      {lens_of("EQUIRECTANGULAR", {400, 200}, 400, 200), 6, 127, false},
      {lens_of("OPENCV_FISHEYE", {60, 60, 130, 115, 0.01, -0.002, 0, 0}, 250, 240), 6, 120, true},
      {lens_of("FISHEYE", {100, 100, 158, 40}, 316, 80), 3, 200, true},  // 181 degrees across, 46 down
      {lens_of("DIVISION", {90, 90, 150, 150, -0.3}, 300, 300), 5, 180, true}};
  for (const auto& [lens, faces, front_size, masked] : cases) {
    INFO(lens.width << "x" << lens.height);
    Image8 seen{lens.width, lens.height, {}};
    for (int j = 0; j < lens.height; ++j)
      for (int i = 0; i < lens.width; ++i) {
        const auto ray = pixel_ray(lens, i + 0.5, j + 0.5);
        seen.rgb.insert(seen.rgb.end(), 3, static_cast<std::uint8_t>(ray ? colour(*ray) + 0.5 : 0));
      }
    const std::vector<Undistortion> plans = plan_views(lens, "test");
    CHECK(plans.size() == faces);
    CHECK(plans[0].face == "front");
    CHECK(plans[0].width == front_size);
    CHECK(percent_left_out(plans) < 0.7);
    std::set<std::string> names;
    double worst = 0;
    bool some_masked = false;
    for (const Undistortion& plan : plans) {
      names.insert(plan.face);
      const Camera camera = camera_of(plan, Camera{});
      const Image8 face = undistort(seen, plan);
      REQUIRE(face.width == camera.width);
      std::size_t covered = 0;
      for (int j = 0; j < face.height; ++j)
        for (int i = 0; i < face.width; ++i) {
          const Ray ray =
              camera.ray(i + 0.5, j + 0.5);  // in world coordinates, which are also those of the wide camera
          const auto p = project_ray(lens, ray);
          if (!covers(plan, i + 0.5, j + 0.5)) {
            some_masked = true;
            continue;
          }
          ++covered;
          REQUIRE(p);
          const bool rim =
              (*p)[0] < 2 || (*p)[1] < 2 || (*p)[0] > lens.width - 2 || (*p)[1] > lens.height - 2;
          if (rim && lens.formula->coefficients != "") continue;
          const double value =
              face.rgb[3 * (static_cast<std::size_t>(j) * static_cast<std::size_t>(face.width) +
                            static_cast<std::size_t>(i))];
          worst = std::max(worst, std::abs(value - colour(ray)));
        }
      CHECK(covered > 100);
      CHECK(plan.whole <=
            (covered == static_cast<std::size_t>(face.width) * static_cast<std::size_t>(face.height)));
    }
    CHECK(names.size() == plans.size());
    CHECK(some_masked == masked);
    // The error comes from rounding to 8 bits twice and from bicubic interpolation. An offset of half a pixel
    // gives 3 or more.
    CHECK(worst < 2.5);
  }
  CHECK(degrees_covered(cases[0].lens) == 360);
  CHECK(degrees_covered(cases[2].lens) == Approx(2 * 1.58 * 180 / pi));
  CHECK(degrees_covered(full_opencv()) < 110);
}

TEST_CASE("lens: distorted() returns false only for lenses that are equal to a pinhole camera", "[lens]") {
  CHECK_FALSE(lens_of("RADIAL", {210, 161, 118, 0, 0}).distorted());
  CHECK_FALSE(lens_of("DIVISION", {210, 205, 161, 118, 0}).distorted());
  CHECK_FALSE(lens_of("EUCM", {210, 205, 161, 118, 0, 1}).distorted());
  CHECK(lens_of("OPENCV_FISHEYE", {210, 205, 161, 118, 0, 0, 0, 0}).distorted());
  CHECK(lens_of("EQUIRECTANGULAR", {320, 240}).distorted());
  CHECK(full_opencv().distorted());
}

TEST_CASE("lens: coefficients outside of a formula's domain are refused", "[lens]") {
  const auto eucm = [](double alpha, double beta) {
    return message_of([&] { make_colmap_camera("EUCM", 32, 24, {20, 20, 16, 12, alpha, beta}, "there"); });
  };
  CHECK_THAT(eucm(1.5, 1), Contains("there: EUCM with alpha = 1.5"));
  CHECK_THAT(eucm(0.5, 0), Contains("beta must be positive"));
  CHECK_THAT(message_of([&] {
               make_colmap_camera("FISHEYE", 32, 24, {20, 20, 16}, "there");
             }),
             Contains("FISHEYE has 4 parameters (fx fy cx cy), found 3"));
}
