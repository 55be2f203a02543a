// SPDX-License-Identifier: Apache-2.0
// triangulate() computes initial points from the images of a still scene. A corner that two images show gives
// a point, and the corners around a pixel limit its possible depth.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

struct Triangulation {
  PointCloud points;
  std::size_t corners = 0;  // number of corner points, which come first; pixels between corners follow
  // How many times as bright one image shows the same corners as a neighbouring image: the ratio that a tenth
  // of the pairs of images exceed. It is 1 if the pairs have too few corners in common.
  double brightness_ratio = 1;
};

// Finds corners (SIFT descriptors) in at most `images` evenly chosen views and matches them between
// neighbours along the epipolar lines of their cameras. Each point is placed where its two rays meet; if
// several pairs show the same point, the pair with the widest angle is used. Then adds about `between` random
// pixels, or fewer if large parts of the images have no texture. The depth of such a pixel is searched in the
// range of the corners around it, and is the one at which the pixel's surroundings agree best with two
// neighbouring images. Returns nothing if the images have no texture, if the scene moves, or in a build
// without OpenCV. Deterministic: repeated calls with the same `seed` return the same points.
Triangulation triangulate(std::span<const View> views, std::size_t images, std::size_t between,
                          std::uint64_t seed);

}  // namespace ubs
