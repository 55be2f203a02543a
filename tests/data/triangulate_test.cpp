// SPDX-License-Identifier: Apache-2.0
// Tests triangulate() with five images of a textured plane: the points must be on the plane, and different
// exposures must be recognised. Also tests Patch, which finds the depth of the pixels between keypoints.
#include "host/dataset/triangulate.hpp"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "host/dataset/patch_depth.hpp"

namespace ubs {
namespace {

constexpr int kWidth = 320, kHeight = 240;
constexpr double kFocal = 300, kDistance = 4;

// Returns the image of the camera at `x`: a plane with random spots at the depth kDistance in front of the
// first camera.
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

TEST_CASE("keypoints of a plane, and pixels between them, are placed on the plane") {
  const std::vector<View> views = views_of_plane();
  const Triangulation found = triangulate(views, 200, 500, 3);
  const auto& points = found.points.positions;
  REQUIRE(found.corners > 300);
  REQUIRE(points.size() > found.corners + 400);
  REQUIRE(found.points.colours.size() == points.size());
  const auto on_plane = [](auto first, auto last) {
    const auto near =
        std::count_if(first, last, [](const auto& p) { return std::abs(p[2] - kDistance) < 0.08; });
    return static_cast<double>(near) / static_cast<double>(last - first);
  };
  const auto between = points.begin() + static_cast<std::ptrdiff_t>(found.corners);
  CHECK(on_plane(points.begin(), between) > 0.98);
  CHECK(on_plane(between, points.end()) > 0.98);
  // Points have the colours of the pixels in which they were found.
  CHECK(std::ranges::count(found.points.colours, std::array<std::uint8_t, 3>{}) < 10);
  CHECK(triangulate(views, 200, 500, 3).points.positions == points);
  CHECK(triangulate(views, 200, 0, 3).points.positions.size() == found.corners);
  // If at most three images are used, fewer keypoints are found.
  CHECK(triangulate(views, 3, 0, 3).corners < found.corners);
  CHECK(triangulate(views, 3, 0, 3).corners > 300);
}

TEST_CASE("different exposures are recognised by the brightness of points that images have in common") {
  std::vector<View> views = views_of_plane();
  const auto ratio = [&] { return triangulate(views, 200, 0, 3).brightness_ratio; };
  CHECK(ratio() < 1.01);
  for (const std::size_t v : {1, 3})
    for (std::uint8_t& value : views[v].image.rgb) value = static_cast<std::uint8_t>(0.8 * value);
  CHECK(ratio() == Approx(1.25).margin(0.02));
  views.resize(2);  // a single pair of images is not enough
  CHECK(ratio() == 1);
}

TEST_CASE("a patch is matched at its depth") {
  const std::vector<View> views = views_of_plane();
  std::vector<GreyPicture> pictures;
  for (const View& view : views) {
    GreyPicture& picture = pictures.emplace_back();
    picture.camera = view.camera;
    picture.width = kWidth, picture.height = kHeight;
    for (std::size_t i = 0; i < view.image.rgb.size(); i += 3) picture.values.push_back(view.image.rgb[i]);
  }
  const Patch patch(pictures[2], {160, 120});
  REQUIRE_FALSE(patch.plain());
  CHECK(patch.agreement(pictures[2], kDistance) == Approx(1).margin(1e-5));
  CHECK(patch.agreement(pictures[1], kDistance) > 0.95);
  CHECK(patch.agreement(pictures[1], 0.5 * kDistance) < 0.7);  // not lower, because all spots are smooth
  const std::array<const GreyPicture*, 2> others{&pictures[1], &pictures[3]};
  const auto depth = patch.best_depth(others, 2, 8, 61, 0.8);
  REQUIRE(depth);
  CHECK(std::abs(*depth - kDistance) < 0.15);
  CHECK_FALSE(patch.best_depth(others, 1, 2, 20, 0.8));  // none of these depths is near that of the patch
  CHECK(Patch(pictures[2], {2, 120}).plain());           // partly outside of the image
}

TEST_CASE("images without texture give no points") {
  std::vector<View> views = views_of_plane();
  for (View& view : views) std::ranges::fill(view.image.rgb, std::uint8_t{90});
  CHECK(triangulate(views, 200, 100, 3).points.positions.empty());
  CHECK(triangulate({}, 200, 100, 3).points.positions.empty());
  for (View& view : views) {
    view.camera.width = view.image.width = 2, view.camera.height = view.image.height = 1;
    view.image.rgb.resize(6);
  }
  CHECK(triangulate(views, 200, 100, 3).points.positions.empty());
}

}  // namespace ubs
