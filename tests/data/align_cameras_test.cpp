// SPDX-License-Identifier: Apache-2.0
// Tests that align_cameras() corrects errors of camera poses. The cameras see a textured wall, and a board in
// front of the wall.
#include "host/dataset/align_cameras.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "host/base/philox.hpp"
#include "host/scene/camera_motion.hpp"

namespace ubs {
namespace {

constexpr int kViews = 10, kAcross = 240, kDown = 180, kTexture = 900;
constexpr double kPixelsAUnit = 90, kToMiddle = 3;

cv::Mat spots(int seed) {
  cv::Mat texture(kTexture, kTexture, CV_8UC3);
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(texture, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(texture, texture, {0, 0}, 2.0);
  cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
  return texture;
}

// Returns camera i on an arc around the point (0, 0, kToMiddle). All cameras look at this point.
Camera camera_at(int i) {
  Camera c;
  c.width = kAcross, c.height = kDown;
  c.fx = c.fy = 210, c.cx = kAcross / 2.0, c.cy = kDown / 2.0;
  const double angle = 0.08 * (i - kViews / 2.0);
  c.rotation = rotation_by({0.05 * std::sin(1.7 * i), angle, 0});
  const std::array<double, 9>& r = c.rotation;
  for (std::size_t k = 0; k < 3; ++k) c.translation[k] = (k == 2 ? kToMiddle : 0) - kToMiddle * r[3 * k + 2];
  return c;
}

View seen_from(const Camera& camera, const cv::Mat& wall, const cv::Mat& board) {
  View view;
  view.camera = camera;
  view.image.width = kAcross, view.image.height = kDown;
  const Vec3 centre = camera.centre();
  cv::Mat across(kDown, kAcross, CV_32F), down(kDown, kAcross, CV_32F), before(kDown, kAcross, CV_8U);
  for (int y = 0; y < kDown; ++y)
    for (int x = 0; x < kAcross; ++x) {
      const Vec3 ray = camera.ray(x + 0.5, y + 0.5);
      Vec3 at = centre + ((2.4 - centre[2]) / ray[2]) * ray;
      const bool on_board = std::abs(at[0]) < 0.7 && std::abs(at[1]) < 0.5;
      if (!on_board) at = centre + ((4 - centre[2]) / ray[2]) * ray;
      before.at<std::uint8_t>(y, x) = on_board ? 255 : 0;
      across.at<float>(y, x) = static_cast<float>(kPixelsAUnit * at[0] + kTexture / 2);
      down.at<float>(y, x) = static_cast<float>(kPixelsAUnit * at[1] + kTexture / 2);
    }
  cv::Mat far, near;
  cv::remap(wall, far, across, down, cv::INTER_LINEAR, cv::BORDER_REFLECT);
  cv::remap(board, near, across, down, cv::INTER_LINEAR, cv::BORDER_REFLECT);
  near.copyTo(far, before);
  view.image.rgb.assign(far.datastart, far.dataend);
  return view;
}

struct PoseErrors {
  // Root mean squares over the cameras: of the rotation angles [rad], and of the distances of the centres
  // [units of the scene].
  double turn = 0, centre = 0;
};

PoseErrors errors(std::vector<Camera> cameras, std::span<const Camera> truth) {
  fix_similarity(cameras, truth);
  PoseErrors e;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const CameraMove move = pose_move(truth[i], cameras[i], 0);  // a rotation around the centre of the camera
    e.turn += dot({move[0], move[1], move[2]}, {move[0], move[1], move[2]});
    const Vec3 away = Vec3(cameras[i].centre()) - truth[i].centre();
    e.centre += dot(away, away);
  }
  return {std::sqrt(e.turn / kViews), std::sqrt(e.centre / kViews)};
}

}  // namespace

TEST_CASE("cameras are aligned by keypoints of their images") {
  const cv::Mat wall = spots(1), board = spots(2);
  std::vector<Camera> truth;
  std::vector<View> views;
  const CounterRandom random(5, 3);
  for (int i = 0; i < kViews; ++i) {
    truth.push_back(camera_at(i));
    views.push_back(seen_from(truth.back(), wall, board));
    CameraMove move{};
    for (std::uint32_t k = 0; k < 6; ++k)
      move[k] = random.uniform(static_cast<std::uint64_t>(i), k, -0.008, 0.008);
    views.back().camera = moved(truth.back(), move, kToMiddle);
  }
  std::vector<Camera> given;
  for (const View& view : views) given.push_back(view.camera);
  const Alignment found = align_cameras(views);
  CHECK(found.aligned == kViews);
  CHECK(found.points > 300);
  CHECK(found.after < 0.07);  // [px]; observed 0.036
  CHECK(found.before > 4 * found.after);
  const PoseErrors before = errors(given, truth), after = errors(found.cameras, truth);
  INFO("rotation error " << after.turn << ", before " << before.turn << "; centre error " << after.centre
                         << ", before " << before.centre);
  CHECK(after.turn < 0.08 * before.turn);      // observed ratio: 0.041
  CHECK(after.centre < 0.11 * before.centre);  // observed ratio: 0.055
  const Alignment again = align_cameras(views);
  for (std::size_t i = 0; i < kViews; ++i) {
    CHECK(again.cameras[i].rotation == found.cameras[i].rotation);
    CHECK(again.cameras[i].translation == found.cameras[i].translation);
  }
}

TEST_CASE("cameras of images without texture are not changed") {
  std::vector<View> views;
  for (int i = 0; i < 5; ++i) {
    View view = seen_from(camera_at(i), spots(1), spots(2));
    std::ranges::fill(view.image.rgb, std::uint8_t{90});
    views.push_back(view);
  }
  const Alignment found = align_cameras(views);
  CHECK(found.aligned == 0);
  REQUIRE(found.cameras.size() == 5);
  CHECK(found.cameras[3].translation == views[3].camera.translation);
  CHECK(align_cameras({}).cameras.empty());
}

}  // namespace ubs
