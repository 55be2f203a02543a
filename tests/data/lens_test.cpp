// SPDX-License-Identifier: Apache-2.0
// Lens models against OpenCV and against themselves, and the undistorted image against the ideal one.
#include "host/data/lens.hpp"

#include <opencv2/calib3d.hpp>

#include "tests/support/images.hpp"

using namespace ubs;
using namespace ubs::test;

namespace {

Lens lens_of(LensModel model, std::initializer_list<double> k) {
  Lens lens{model, 210, 205, 161, 118, 320, 240, {}};
  std::copy(k.begin(), k.end(), lens.k.begin());
  return lens;
}

const Lens kLenses[] = {
    lens_of(LensModel::opencv, {-0.15, 0.03, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001}),
    lens_of(LensModel::opencv, {0.08}),
    lens_of(LensModel::opencv_fisheye, {0.02, -0.01, 0.003, -0.001}),
    lens_of(LensModel::fov, {0.7}),
    lens_of(LensModel::thin_prism_fisheye, {0.02, -0.01, 0.001, -0.001, 0.002, 0.001, 0.003, -0.002}),
    lens_of(LensModel::rad_tan_thin_prism_fisheye,
            {0.02, -0.01, 0.002, 0.001, 0, 0, 0.001, -0.001, 0.002, 0.001, -0.001, 0.0005}),
};

}  // namespace

TEST_CASE("lens: distortion agrees with OpenCV", "[lens]") {
  const std::vector<cv::Point3d> rays{{0, 0, 1}, {0.3, -0.2, 1}, {-0.6, 0.5, 1}, {0.7, 0.55, 1}};
  const cv::Matx33d identity = cv::Matx33d::eye();
  const cv::Vec3d zero(0, 0, 0);
  std::vector<cv::Point2d> expected;
  const auto compare = [&](const Lens& lens) {
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const auto d = distort(lens, rays[i].x, rays[i].y);
      CHECK(d[0] == Approx(expected[i].x).margin(1e-12));
      CHECK(d[1] == Approx(expected[i].y).margin(1e-12));
    }
  };
  const Lens& full = kLenses[0];
  cv::projectPoints(rays, zero, zero, identity, std::vector<double>(full.k.begin(), full.k.begin() + 8),
                    expected);
  compare(full);
  const Lens& fisheye = kLenses[2];
  cv::fisheye::projectPoints(rays, expected, zero, zero, identity,
                             std::vector<double>(fisheye.k.begin(), fisheye.k.begin() + 4));
  compare(fisheye);
}

TEST_CASE("lens: undistort_point inverts distort", "[lens]") {
  for (const Lens& lens : kLenses)
    for (const double x : {-0.6, 0.0, 0.45})
      for (const double y : {-0.5, 0.02, 0.55}) {
        const auto d = distort(lens, x, y);
        double bx = 9, by = 9;
        REQUIRE(undistort_point(lens, d[0], d[1], bx, by));
        CHECK(bx == Approx(x).margin(1e-8));
        CHECK(by == Approx(y).margin(1e-8));
      }
}

TEST_CASE("lens: a fold of the polynomial is no solution", "[lens]") {
  const Lens lens = lens_of(LensModel::opencv, {-0.9});  // r (1 - 0.9 r^2) has its maximum at 0.61: 0.406
  double x = 0, y = 0;
  CHECK(undistort_point(lens, 0.35, 0, x, y));
  CHECK_FALSE(undistort_point(lens, 0.5, 0, x, y));
}

// The distorted picture of a known function of the ray; undistorting it must give that function back.
TEST_CASE("lens: the undistorted image is what an ideal camera sees", "[lens]") {
  const auto colour = [](double x, double y) { return 127 + 100 * std::sin(9 * x) * std::cos(7 * y); };
  for (const Lens& lens : kLenses) {
    Image8 seen{lens.width, lens.height, {}};
    for (int j = 0; j < lens.height; ++j)
      for (int i = 0; i < lens.width; ++i) {
        double x = 0, y = 0;
        undistort_point(lens, (i + 0.5 - lens.cx) / lens.fx, (j + 0.5 - lens.cy) / lens.fy, x, y);
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
    // 8-bit rounding twice and bicubic interpolation; half a pixel of misplacement would give 8 and more.
    CHECK(worst < 3.0);
  }
}

TEST_CASE("lens: no distortion, no plan", "[lens]") {
  CHECK_FALSE(lens_of(LensModel::opencv, {0, 0}).distorted());
  CHECK(lens_of(LensModel::opencv_fisheye, {0, 0}).distorted());
  CHECK(kLenses[0].distorted());
}
