// SPDX-License-Identifier: Apache-2.0
// LensImage draws what a lens that is no pinhole sees: a panorama, or a fisheye image. The rasteriser draws
// the faces of a cube around the camera (host/data/undistort.hpp), and compose() resamples them to the image.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host/data/undistort.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

// WideLens is a lens and the largest angle between its optical axis and what it shows [rad].
struct WideLens {
  Lens lens;
  double max_angle;
};
// Reads "equirectangular" (360 degrees across, 180 down), "fisheye" or "fisheye:DEGREES" (equidistant; a
// circle of so many degrees, 1 to 360 [180], fills the shorter side). Throws Error(usage) for other texts.
WideLens wide_lens(const std::string& text, int width, int height);

class LensImage {
 public:
  // Throws Error(usage) for an image that is too small: less than about 50 pixels for 360 degrees.
  explicit LensImage(const WideLens& lens);

  // Returns the pinhole cameras whose images compose() needs, in its order. Only the pose of `camera` counts,
  // and its query values. They have about twice the resolution of the image.
  std::vector<Camera> faces(const Camera& camera) const;
  // Returns the image: the mean of four samples a pixel, interpolated in the faces. Depth is the distance
  // from the camera along the ray. Pixels that the lens does not show are black, with alpha and depth 0.
  RenderedView compose(std::span<const RenderedView> faces) const;

 private:
  Lens fine_;  // of twice the width and height
  double max_angle_;
  std::vector<Undistortion> plans_;
  std::array<int, 6> face_of_axis_;  // by the direction: +x, -x, +y, -y, +z, -z; -1: no face
};

}  // namespace ubs
