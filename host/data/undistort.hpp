// SPDX-License-Identifier: Apache-2.0
// Resampling of images to pinhole cameras, which are all that the rasteriser supports. An image of a lens
// with distortion becomes one pinhole view of the same focal length. A wide image, of more than 110 degrees,
// would need many pixels there for little detail at its border, and beyond 180 degrees it does not fit at
// all: it becomes several views of 90 degrees from the same position, the faces of a cube around the camera.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "host/data/lens.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

// Undistortion describes one pinhole view that is resampled from an image.
struct Undistortion {
  Lens lens;                                                  // of the image
  int width = 0, height = 0;                                  // of the view
  double fx = 1, fy = 1;                                      // of the view [px]
  double cx = 0, cy = 0;                                      // of the view [px]
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  // camera of the image -> camera of the view
  std::string face;      // front, right, back, left, up or down; empty: the only view of the image
  double max_angle = 4;  // rays farther from the optical axis [rad] are not in the image
  bool whole = true;     // false: some pixels of the view may have no pixel of the image
};

// Returns how many degrees the image covers, across or down, whichever is more.
double degrees_covered(const Lens& lens);

// Returns the largest upright rectangle of the ideal image all of whose pixels the lens has seen. `where`
// starts the message when the parameters leave no usable rectangle.
Undistortion plan_undistortion(const Lens& lens, const std::string& where);

// Returns the faces of the cube in which the image has pixels, each cut to the part that has some. Their
// focal length is the resolution of the image at the centre of the face: where it differs between directions,
// the smaller one. Faces with less than 16 pixels in a direction are left out, which may be all of them.
std::vector<Undistortion> plan_faces(const Lens& lens, const std::string& where);

// plan_faces() for a wide image, unless it is too small for faces; else plan_undistortion().
std::vector<Undistortion> plan_views(const Lens& lens, const std::string& where);

// Returns the camera of a view, given the pose of the image's camera. Its size is that of the plan.
Camera camera_of(const Undistortion& plan, Camera pose);

// Returns the part of the image, in percent, that none of the views shows: found on a grid of its pixels.
double percent_left_out(const std::vector<Undistortion>& plans);

// Returns whether the image has a pixel for a position of the view.
bool covers(const Undistortion& plan, double column, double row);

// Returns the view of an image. Bicubic resampling (OpenCV remap); `image` must have the size of the lens.
Image8 undistort(const Image8& image, const Undistortion& plan);

}  // namespace ubs
