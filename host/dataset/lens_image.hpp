// SPDX-License-Identifier: Apache-2.0
// LensImage composes panoramas and fisheye images. The rasteriser supports only pinhole cameras, so it
// renders the faces of a cube around the camera (host/dataset/undistort.hpp), and compose() resamples these
// renders to the panorama or fisheye image.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host/dataset/undistort.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/rendered_view.hpp"

namespace ubs {

// WideLens is a lens and the largest angle between its optical axis and the rays that it shows [rad].
struct WideLens {
  Lens lens;
  double max_angle;
};
// Returns the lens that `text` describes, for an image of the given size. "equirectangular" is a panorama of
// 360 degrees across and 180 degrees down. "fisheye:DEGREES" is an equidistant fisheye lens; DEGREES is from
// 1 to 360. It is the angle of the image circle, whose diameter is the shorter side of the image. "fisheye"
// is the same as "fisheye:180". Throws Error(usage) for other texts.
WideLens wide_lens(const std::string& text, int width, int height);

class LensImage {
 public:
  // Throws Error(usage) if the image has too many pixels per degree, and Error(memory) if there is not
  // enough memory for the faces. Messages start with `where`.
  LensImage(const WideLens& lens, const std::string& where);

  // Throws Error(usage) if the image has so few pixels that a face is missing, which happens below about 25
  // pixels per 360 degrees.
  void check_complete() const;

  std::size_t face_count() const { return plans_.size(); }
  // Returns the pinhole cameras of the faces, in the order in which compose() expects their images. They are
  // at the position of `camera` and have its time and further query values. Each of them looks along the axis
  // of one face. Their resolution is about twice that of the image.
  std::vector<Camera> faces(const Camera& camera) const;
  // Returns the image that is composed of the renders of the faces. Each pixel is the mean of four samples,
  // which are interpolated in the faces. The depth is the distance from the camera along the ray. Samples
  // that the lens does not show are 0, so pixels without any shown sample are black, with alpha 0 and depth
  // 0.
  RenderedView compose(std::span<const RenderedView> faces) const;
  // Returns 255 for each pixel that compose() determines completely, and 0 for the others.
  std::vector<std::uint8_t> shown() const;

 private:
  // Returns the ray of a position [px] in the image of the lens `fine_`, or nullopt if the lens does not show
  // it.
  std::optional<Ray> shown_ray(double column, double row) const;
  // Calls visit(pixel, ray) for each sample that the lens shows and whose ray hits a face. `pixel` is the
  // index of the pixel that contains the sample.
  template <typename Visit>
  void for_samples(const Visit& visit) const;

  std::string where_;
  Lens fine_;         // the lens for an image with twice the width and height
  double max_angle_;  // [rad] WideLens::max_angle
  std::vector<Undistortion> plans_;
  std::array<int, 6> face_of_axis_;  // index in plans_ for each result of axis_of(); -1 if there is no face
};

}  // namespace ubs
