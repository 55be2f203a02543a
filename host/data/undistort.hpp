// SPDX-License-Identifier: Apache-2.0
// undistort() resamples images to pinhole cameras, the only cameras that the rasteriser supports. An image of
// a lens with distortion becomes one pinhole view of the same focal length. For a wide image, of more than
// 110 degrees, one view would need many pixels for little detail at its border, and beyond 180 degrees one
// view is impossible. So a wide image becomes several views of 90 degrees from the same position: the faces
// of a cube around the camera.
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

// Returns the angle [degrees] that the image covers, across or down, whichever is larger.
double degrees_covered(const Lens& lens);

// Returns the largest upright rectangle of the ideal image in which the lens saw every pixel. If the
// parameters leave no usable rectangle, throws an error whose message starts with `where`.
Undistortion plan_undistortion(const Lens& lens, const std::string& where);

// Returns the faces of the cube that show a part of the image, each cropped to that part. The focal length of
// a face is the resolution of the image at the centre of the face; if that differs between directions, the
// lower one. Faces with less than 16 pixels in a direction are skipped, so the result may be empty.
std::vector<Undistortion> plan_faces(const Lens& lens, const std::string& where);

// Returns plan_faces() for a wide image unless it is too small for faces, otherwise plan_undistortion().
std::vector<Undistortion> plan_views(const Lens& lens, const std::string& where);

// Returns the camera of a view, given the pose of the image's camera. Its size is that of the plan.
Camera camera_of(const Undistortion& plan, Camera pose);

// Returns the part of the image, in percent, that no view shows. Estimated on a grid of pixels.
double percent_left_out(const std::vector<Undistortion>& plans);

// Returns whether the image covers a position of the view.
bool covers(const Undistortion& plan, double column, double row);

// Resamples an image to a view with bicubic interpolation (OpenCV remap). `image` must have the size of the
// lens.
Image8 undistort(const Image8& image, const Undistortion& plan);

}  // namespace ubs
