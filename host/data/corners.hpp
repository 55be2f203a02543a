// SPDX-License-Identifier: Apache-2.0
// find_corners() finds the corners (keypoints) of an image; other functions match corners between two images.
// They are used to find scene points that several images show (triangulate.hpp) and to correct cameras
// (align_cameras.hpp).
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
  std::vector<Vec3> rays;  // in world space, of unit depth in the camera
  std::vector<Pixel> at;
  std::vector<std::array<std::uint8_t, 3>> colours;
  cv::Mat descriptors;  // float, one row per corner
  // The corners sorted into square cells of `cell` pixels, whose numbers count down the columns of cells. The
  // corners of cell i are sorted[first[i]] to sorted[first[i + 1] - 1].
  double cell = 1;
  std::size_t cells_down = 0;
  std::vector<std::size_t> first, sorted;
  const Camera& camera() const { return picture.camera; }
  // Size of a pixel of the searched image, in pixels of the camera.
  double pixel() const { return picture.across; }
};

// Finds the corners of an image, reduced to at most 800 pixels across, with SIFT descriptors. Dense corners
// are at whole pixels; their descriptors are upright and of a small fixed size. Distinct corners are at
// subpixel positions and have their own size and direction.
enum class CornerKind { dense, distinct };
Corners find_corners(const View& view, CornerKind kind);

// Pairs each camera with the `most` cameras that see the most similar part of the scene: near in position and
// direction, but not at the same position. Returns the pairs of indices, sorted and without duplicates.
std::vector<std::pair<std::size_t, std::size_t>> neighbours(std::span<const Camera> cameras,
                                                            std::size_t most);

// Returns, for each corner of `from`, the index of the corner of `to` with the most similar descriptor, or -1
// if no corner is similar enough. Only corners at most `band` pixels of the searched image away from the
// epipolar line are considered.
std::vector<std::ptrdiff_t> best_along_lines(const Corners& from, const Corners& to, double band);

Vec3 in_camera(const Camera& camera, const Vec3& point);
// Returns the pixel at which the camera sees the point, if the point is in front of it.
std::optional<Pixel> seen_at(const Camera& camera, const Vec3& point);

// Returns the index of the pixel that contains `at`.
inline std::size_t pixel_index(const Image8& image, const Pixel& at) {
  const int x = std::clamp(static_cast<int>(at[0]), 0, image.width - 1);
  const int y = std::clamp(static_cast<int>(at[1]), 0, image.height - 1);
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
}

// Union-find structure for corners of all images that show the same scene point. A track is identified by the
// smallest index of its corners.
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
