// SPDX-License-Identifier: Apache-2.0
// Points from pictures: of a textured plane that five cameras see, which lie on it.
#include "host/data/triangulate.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "host/scene/frustum_points.hpp"

namespace ubs {
namespace {

constexpr int kWidth = 320, kHeight = 240;
constexpr double kFocal = 300, kDistance = 4;

// A plane of random spots at depth kDistance before the first camera, as the camera at `x` sees it.
View plane_seen_from(double x, const cv::Mat& texture) {
  View view;
  view.name = std::to_string(x);
  view.camera.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  view.camera.translation = {-x, 0, 0};
  view.camera.width = kWidth, view.camera.height = kHeight;
  view.camera.fx = view.camera.fy = kFocal;
  view.camera.cx = kWidth / 2.0, view.camera.cy = kHeight / 2.0;
  const double shift = x * kFocal / kDistance;
  const cv::Mat move = (cv::Mat_<double>(2, 3) << 1, 0, -shift - 100, 0, 1, -100);
  cv::Mat seen;
  cv::warpAffine(texture, seen, move, {kWidth, kHeight}, cv::INTER_LINEAR);
  view.image.width = kWidth, view.image.height = kHeight;
  view.image.rgb.assign(seen.datastart, seen.dataend);
  return view;
}

std::vector<View> views_of_plane() {
  cv::Mat texture(kHeight + 200, kWidth + 200, CV_8UC3);
  cv::RNG random(7);
  random.fill(texture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(texture, texture, {0, 0}, 2.5);
  cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
  std::vector<View> views;
  for (const double x : {-0.6, -0.3, 0.0, 0.3, 0.6}) views.push_back(plane_seen_from(x, texture));
  return views;
}

}  // namespace

TEST_CASE("corners of a plane are placed on it") {
  const std::vector<View> views = views_of_plane();
  const Triangulation found = triangulate(views);
  const auto& points = found.points.positions;
  REQUIRE(points.size() > 300);
  REQUIRE(found.points.colours.size() == points.size());
  const auto near =
      std::ranges::count_if(points, [](const auto& p) { return std::abs(p[2] - kDistance) < 0.08; });
  CHECK(static_cast<double>(near) > 0.9 * static_cast<double>(points.size()));
  REQUIRE(found.seen.size() == views.size());
  CHECK(found.seen[2].size() > 100);
  CHECK(triangulate(views).points.positions == points);

  // Filled in at the same depth, in the colours of the picture.
  const PointCloud filled = sample_near(views, found.seen, 500, 3);
  REQUIRE(filled.positions.size() == 500);
  std::size_t on_plane = 0;
  for (const auto& p : filled.positions) on_plane += std::abs(p[2] - kDistance) < 0.08;
  CHECK(on_plane > 450);
}

TEST_CASE("pictures without texture give no points") {
  std::vector<View> views = views_of_plane();
  for (View& view : views) std::ranges::fill(view.image.rgb, std::uint8_t{90});
  CHECK(triangulate(views).points.positions.empty());
  CHECK(triangulate({}).points.positions.empty());
  CHECK(sample_near(views, triangulate(views).seen, 100, 3).positions.empty());
}

}  // namespace ubs
