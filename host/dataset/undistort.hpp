// SPDX-License-Identifier: Apache-2.0
// undistort() resamples images to pinhole cameras, which are the only cameras that the rasteriser supports.
// An image of a lens with distortion becomes one pinhole view with the same focal length. A wide image is an
// image of more than 110 degrees. A single view of such an image would have many pixels with little detail at
// its border, and beyond 180 degrees a single view is impossible. So a wide image becomes several views of at
// most 90 degrees from the same position, which are the faces of a cube around the camera.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "host/dataset/lens.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

// Undistortion describes one pinhole view that is resampled from an image.
struct Undistortion {
  Lens lens;                  // lens of the image
  int width = 0, height = 0;  // size of the view
  double fx = 1, fy = 1;      // focal lengths of the view [px]
  double cx = 0, cy = 0;      // principal point of the view [px]
  // Rotation from the axes of the image's camera to those of the view's camera, row by row.
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
  // Face of the cube: front, right, back, left, up or down. Empty if this is the only view of the image.
  std::string face;
  // [rad] Rays with a larger angle to the optical axis are not in the image. The default excludes no rays,
  // because it is larger than pi.
  double max_angle = 4;
  bool whole = true;  // whether the image covers all pixels of the view
};

// Returns the larger of the horizontal and the vertical angle of view of the image [degrees].
double degrees_covered(const Lens& lens);

// Returns a single view of the image. The view is a rectangle of the ideal image, and the distorted image
// covers this rectangle completely. Undistortion turns each border of the distorted image into a curve. The
// corresponding side of the rectangle is at the innermost point of this curve, but at most twice as far from
// the principal point as the border is in the distorted image. If the parameters of the lens leave no usable
// rectangle, throws an error whose message starts with `where`.
Undistortion plan_undistortion(const Lens& lens, const std::string& where);

// Returns the faces of the cube that show a part of the image, each cropped to this part. The focal length of
// a face is the resolution of the image, in pixels per radian, at the centre of the face, or at the visible
// ray that is nearest to the centre. If the resolution differs between directions, the lowest one is used.
// Faces with fewer than 16 pixels in a direction are skipped, so the result may be empty. Throws Error(data)
// with a message that starts with `where` if a resolution is 16384 or more, or not a number.
std::vector<Undistortion> plan_faces(const Lens& lens, const std::string& where);

// Returns the views of an image. For a wide image, these are the faces of plan_faces(), if there are any.
// Otherwise the result is the single view of plan_undistortion().
std::vector<Undistortion> plan_views(const Lens& lens, const std::string& where);

// Returns the camera of a view. `pose` is the camera of the image. Only its pose and its query values are
// used.
Camera camera_of(const Undistortion& plan, Camera pose);

// Returns the part of the image, in percent, that no view shows. It is estimated on a grid of pixels.
double percent_left_out(const std::vector<Undistortion>& plans);

// Returns whether the image covers a position [px] of the view.
bool covers(const Undistortion& plan, double column, double row);

// Resamples an image to a view with bicubic interpolation (OpenCV remap). `image` must have the size of the
// lens.
Image8 undistort(const Image8& image, const Undistortion& plan);

}  // namespace ubs
