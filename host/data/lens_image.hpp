// SPDX-License-Identifier: Apache-2.0
// LensImage composes panoramas and fisheye images. The rasteriser supports only pinhole cameras, so it
// renders the faces of a cube around the camera (host/data/undistort.hpp), and compose() resamples them to
// the image.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host/data/undistort.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/rendered_view.hpp"

namespace ubs {

// WideLens is a lens and the largest angle between its optical axis and the rays that it shows [rad].
struct WideLens {
  Lens lens;
  double max_angle;
};
// Reads "equirectangular" (360 degrees across, 180 down), "fisheye" or "fisheye:DEGREES" (equidistant; a
// circle of 1 to 360 degrees [180] fills the shorter side). Throws Error(usage) for other texts.
WideLens wide_lens(const std::string& text, int width, int height);

class LensImage {
 public:
  // Throws Error(usage) if the image has too many pixels for its angle, and Error(memory) if there is not
  // enough memory for the faces. Messages start with `where`.
  LensImage(const WideLens& lens, const std::string& where);

  // Throws Error(usage) if the image has so few pixels (less than about 25 for 360 degrees) that faces are
  // missing.
  void check_complete() const;

  std::size_t face_count() const { return plans_.size(); }
  // Returns the pinhole cameras whose images compose() needs, in the same order. They have the pose and the
  // query values of `camera`, and about twice the resolution of the image.
  std::vector<Camera> faces(const Camera& camera) const;
  // Returns the image. Each pixel is the mean of four samples, interpolated in the faces. The depth is the
  // distance from the camera along the ray. Pixels that the lens does not show are black, with alpha and
  // depth 0.
  RenderedView compose(std::span<const RenderedView> faces) const;
  // Returns 255 for each pixel that compose() determines completely, and 0 for the others.
  std::vector<std::uint8_t> shown() const;

 private:
  // Returns the ray of a position in the fine image if the lens shows it.
  std::optional<Ray> shown_ray(double column, double row) const;
  // Calls visit(pixel, ray) for each sample of the image that the lens shows and that is in a face.
  template <typename Visit>
  void for_samples(const Visit& visit) const;

  std::string where_;
  Lens fine_;  // with twice the width and height
  double max_angle_;
  std::vector<Undistortion> plans_;
  std::array<int, 6> face_of_axis_;  // indexed by axis_of(); -1: no face
};

}  // namespace ubs
