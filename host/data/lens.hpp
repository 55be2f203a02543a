// SPDX-License-Identifier: Apache-2.0
// Lens models of COLMAP and nerfstudio, and the resampling of a distorted image to an ideal pinhole
// camera of the same focal length. The rasteriser knows pinhole cameras only.
#pragma once

#include <array>
#include <string>

#include "host/scene/dataset.hpp"

namespace ubs {

enum class LensModel {
  opencv,                      // k: k1 k2 p1 p2 k3 k4 k5 k6 (rational radial, tangential); all zero: pinhole
  opencv_fisheye,              // k: k1 k2 k3 k4
  fov,                         // k: omega
  thin_prism_fisheye,          // k: k1 k2 p1 p2 k3 k4 sx1 sy1
  rad_tan_thin_prism_fisheye,  // k: k0 .. k5, p0 p1, s0 .. s3
};

struct Lens {
  LensModel model = LensModel::opencv;
  double fx = 1, fy = 1, cx = 0, cy = 0;  // [px]; the centre of pixel (0,0) is (0.5, 0.5)
  int width = 0, height = 0;
  std::array<double, 12> k{};

  bool operator==(const Lens&) const = default;
  bool distorted() const;  // false: an ideal pinhole camera
  Lens scaled_to(int new_width, int new_height) const;
};

// Where the ray (x, y, 1) meets the image plane, in units of the focal length. Camera axes of COLMAP.
std::array<double, 2> distort(const Lens& lens, double x, double y);

// The inverse. False when the iteration finds no ray in front of the camera.
bool undistort_point(const Lens& lens, double xd, double yd, double& x, double& y);

// The largest upright rectangle of the ideal image all of whose pixels the lens has seen.
struct Undistortion {
  Lens lens;
  int width = 0, height = 0;  // of the ideal image; same fx, fy
  double cx = 0, cy = 0;
};

// `where` starts the message when the parameters leave no usable rectangle.
Undistortion plan_undistortion(const Lens& lens, const std::string& where);

// Bicubic resampling (OpenCV remap); `image` must have the size of the lens.
Image8 undistort(const Image8& image, const Undistortion& plan);

}  // namespace ubs
