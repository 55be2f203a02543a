// SPDX-License-Identifier: Apache-2.0
// triangulate() computes initial points from the images of a static scene. Each corner that is found in at
// least two images gives a point. Further points are placed at pixels between the corners; the depths of the
// corners around a pixel limit its possible depth.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

struct Triangulation {
  PointCloud points;
  std::size_t corners = 0;  // number of points at corners; they precede the points at other pixels
  // Ratio of brightness between neighbouring images. The ratio of a pair of images says how many times as
  // bright the same corners are in the brighter image. The value stored here is exceeded by a tenth of the
  // pairs. It is 1 if too few pairs have enough corners in common.
  double brightness_ratio = 1;
};

// Finds corners in at most `images` evenly chosen views, and matches their SIFT descriptors between
// neighbouring views along the epipolar lines of the cameras. The point of a match is near the place where
// its two rays meet; its exact depth is found by a comparison of the pixels around both corners. If several
// pairs of views show the same point, the pair with the widest angle between the rays is used. Then adds
// about `between` points at random pixels, or fewer if large parts of the images have no texture. The depth
// of such a pixel is searched in the range of the depths of the corners around it. The chosen depth is the
// one at which the pixels around it agree best with two neighbouring images. Returns no points if no corners
// can be matched, for example because the images have no texture, and in a build without OpenCV. The function
// is deterministic: repeated calls with the same `seed` return the same points.
Triangulation triangulate(std::span<const View> views, std::size_t images, std::size_t between,
                          std::uint64_t seed);

}  // namespace ubs
