// SPDX-License-Identifier: Apache-2.0
// Corners of pictures, and which of two pictures are the same: for points that pictures show
// (triangulate.hpp), and for the cameras that they were taken with (align_cameras.hpp).
#pragma once

#include <array>
#include <cstdint>
#include <numeric>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "host/base/vector3.hpp"
#include "host/data/patch_depth.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

struct Corners {
  GreyPicture picture;
  std::vector<Vec3> rays;  // in the world, of unit depth
  std::vector<Pixel> at;
  std::vector<std::array<std::uint8_t, 3>> colours;
  cv::Mat descriptors;                           // float, a row a corner
  std::vector<std::vector<std::size_t>> strips;  // corners by column, then by row
  const Camera& camera() const { return picture.camera; }
  double pixel() const { return picture.across; }  // of the searched picture, in pixels of the camera
};

// Of the picture in at most 800 pixels across, with SIFT descriptors. Dense ones are whole pixels, described
// upright and small; distinct ones have their own size and direction, and are found between pixels.
enum class CornerKind { dense, distinct };
Corners find_corners(const View& view, CornerKind kind);

// Of each camera the `most` that see alike: near in position and direction, but not from the same place.
std::vector<std::pair<std::size_t, std::size_t>> neighbours(std::span<const Camera> cameras,
                                                            std::size_t most);

// The corner of `to` that looks most like each of `from`, among those at most `band` pixels of the searched
// picture from its epipolar line; or -1.
std::vector<std::ptrdiff_t> best_along_lines(const Corners& from, const Corners& to, double band);

Vec3 in_camera(const Camera& camera, const Vec3& point);
// Where the camera shows the point, if it is before it.
std::optional<Pixel> seen_at(const Camera& camera, const Vec3& point);

// Of the pixel that `at` lies in.
inline std::size_t pixel_index(const Image8& image, const Pixel& at) {
  const int x = std::clamp(static_cast<int>(at[0]), 0, image.width - 1);
  const int y = std::clamp(static_cast<int>(at[1]), 0, image.height - 1);
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
}

// Corners of all pictures that are one point, told by the smallest of their numbers.
class Tracks {
 public:
  explicit Tracks(std::size_t corners) : parent_(corners) { std::iota(parent_.begin(), parent_.end(), 0); }
  std::size_t of(std::size_t k) {
    while (parent_[k] != k) k = parent_[k] = parent_[parent_[k]];
    return k;
  }
  void join(std::size_t a, std::size_t b) { parent_[std::max(of(a), of(b))] = std::min(of(a), of(b)); }

 private:
  std::vector<std::size_t> parent_;
};

}  // namespace ubs
