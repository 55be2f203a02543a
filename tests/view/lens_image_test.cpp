// SPDX-License-Identifier: Apache-2.0
// Tests panoramas and fisheye images, which are composed of several pinhole images, the faces
// (host/dataset/lens_image.hpp).
#include "host/dataset/lens_image.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>

#include "host/base/vector3.hpp"
#include "tests/support/compare.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

// Returns a colour that depends smoothly on the direction in the world.
Ray colour_of(const Ray& direction) {
  const Ray d = normalised(direction);
  return {0.5 + 0.3 * d[0], 0.5 + 0.2 * d[1] * d[2], 0.4 + 0.3 * d[2] * d[0]};
}

// Returns the image that a pinhole camera shows if each direction has the colour colour_of(). The depths are
// those of a sphere with the radius 5 around the camera.
RenderedView seen_by(const Camera& camera) {
  RenderedView view{camera.width, camera.height, {}, {}, {}};
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Ray ray{(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1};
      const auto& m = camera.rotation;
      const Ray world{m[0] * ray[0] + m[3] * ray[1] + m[6], m[1] * ray[0] + m[4] * ray[1] + m[7],
                      m[2] * ray[0] + m[5] * ray[1] + m[8]};
      for (const double c : colour_of(world)) view.rgb.push_back(static_cast<float>(c));
      view.alpha.push_back(1);
      view.depth.push_back(static_cast<float>(5 / length(ray)));
    }
  return view;
}

Camera turned_camera() {
  Camera camera;
  const double a = 0.7, c = std::cos(a), s = std::sin(a);
  camera.rotation = {c, 0, s, 0, 1, 0, -s, 0, c};
  camera.translation = {1, -2, 0.5};
  return camera;
}

RenderedView composed(const WideLens& lens, const Camera& camera) {
  const LensImage image(lens, "--lens");
  std::vector<RenderedView> faces;
  for (const Camera& face : image.faces(camera)) {
    for (std::size_t k = 0; k < 3; ++k) CHECK(face.centre()[k] == Approx(camera.centre()[k]).margin(1e-12));
    faces.push_back(seen_by(face));
  }
  return image.compose(faces);
}

// Returns the direction in the world that a pixel of the image shows. It is computed from the definition of
// the lens.
Ray direction(const std::string& lens, double degrees, int width, int height, double x, double y) {
  Ray ray;
  if (lens == "equirectangular") {
    const double longitude = (x / width - 0.5) * 2 * std::numbers::pi;
    const double latitude = (y / height - 0.5) * std::numbers::pi;
    ray = {std::sin(longitude) * std::cos(latitude), std::sin(latitude),
           std::cos(longitude) * std::cos(latitude)};
  } else {
    const double u = x - width / 2.0, v = y - height / 2.0, r = std::hypot(u, v);
    const double angle = r / std::min(width, height) * degrees * std::numbers::pi / 180;
    ray = {std::sin(angle) * u / r, std::sin(angle) * v / r, std::cos(angle)};
  }
  const auto m = turned_camera().rotation;
  return {m[0] * ray[0] + m[3] * ray[1] + m[6] * ray[2], m[1] * ray[0] + m[4] * ray[1] + m[7] * ray[2],
          m[2] * ray[0] + m[5] * ray[1] + m[8] * ray[2]};
}

}  // namespace

TEST_CASE("lens image: each pixel has the colour and the depth of its direction", "[lens]") {
  for (const auto& [lens, degrees, width, height] : {std::tuple{"equirectangular", 360.0, 256, 128},
                                                     {"fisheye", 180.0, 128, 128},
                                                     {"fisheye:220", 220.0, 160, 128},
                                                     {"fisheye:90", 90.0, 128, 160}}) {
    const RenderedView image = composed(wide_lens(lens, width, height), turned_camera());
    INFO(lens);
    REQUIRE((image.width == width && image.height == height));
    double worst = 0, worst_depth = 0;
    int shown = 0, dark = 0;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const auto at = static_cast<std::size_t>(y * width + x);
        const double radius = std::hypot(x + 0.5 - width / 2.0, y + 0.5 - height / 2.0);
        const bool circle = std::string(lens) != "equirectangular";
        if (circle && radius > std::min(width, height) / 2.0 + 1) {
          CHECK((image.alpha[at] == 0 && image.rgb[3 * at] == 0 && image.depth[at] == 0));
          ++dark;
          continue;
        }
        if (circle && radius > std::min(width, height) / 2.0 - 1) continue;  // the border of the circle
        const Ray want = colour_of(direction(std::string(lens).substr(0, 7) == "fisheye" ? "fisheye" : lens,
                                             degrees, width, height, x + 0.5, y + 0.5));
        for (std::size_t c = 0; c < 3; ++c)
          worst = std::max(worst, std::abs(static_cast<double>(image.rgb[3 * at + c]) - want[c]));
        worst_depth = std::max(worst_depth, std::abs(static_cast<double>(image.depth[at]) - 5));
        ++shown;
      }
    CHECK(worst < 2e-3);
    CHECK(worst_depth < 2e-2);
    CHECK(shown > width * height / 2);
    CHECK((dark > 0) == (std::string(lens) != "equirectangular"));
  }
}

TEST_CASE("lens image: unknown lenses and unsuitable sizes are rejected", "[lens]") {
  for (const char* text : {"", "pinhole", "fisheye:", "fisheye:0", "fisheye:361", "fisheye:nan", "fisheye180",
                           "fisheye:90x", "equirectangular:360"})
    CHECK_THAT(message_of([&] { wide_lens(text, 64, 64); }, ErrorKind::usage),
               Contains("--lens") && Contains("fisheye:DEGREES"));
  const auto check_complete = [](const WideLens& lens) { LensImage(lens, "--lens").check_complete(); };
  CHECK_THAT(message_of([&] { check_complete(wide_lens("equirectangular", 8, 4)); }, ErrorKind::usage),
             Contains("8x4 pixels are too few"));
  CHECK_THAT(message_of([&] { check_complete(wide_lens("fisheye:200", 12, 12)); }, ErrorKind::usage),
             Contains("12x12 pixels are too few"));
  CHECK_THAT(message_of([&] { LensImage(wide_lens("fisheye:10", 4096, 4096), "--lens"); }, ErrorKind::usage),
             Contains("4096x4096 pixels are too many"));
}
