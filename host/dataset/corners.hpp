// SPDX-License-Identifier: Apache-2.0
// find_corners() finds the corners (keypoints) of an image; other functions match corners between two images.
// Matched corners are used to triangulate scene points (triangulate.hpp) and to correct camera poses
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
#include "host/dataset/patch_depth.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

struct Corners {
  GreyPicture picture;     // the searched image
  std::vector<Vec3> rays;  // directions in world space, scaled so that their depth in the camera is 1
  std::vector<Pixel> at;   // positions in pixels of the original image
  std::vector<std::array<std::uint8_t, 3>> colours;
  cv::Mat descriptors;  // float, one row per corner
  // The corners are sorted into square cells. `cell` is the length of their side in pixels of the original
  // image. The cells are numbered from top to bottom, one column of `cells_down` cells after the other. The
  // corners of cell i are sorted[first[i]] to sorted[first[i + 1] - 1].
  double cell = 1;
  std::size_t cells_down = 0;
  std::vector<std::size_t> first, sorted;
  const Camera& camera() const { return picture.camera; }
  // Returns the width of a pixel of the searched image, in pixels of the original image.
  double pixel() const { return picture.across; }
};

// Finds the corners of an image and computes their SIFT descriptors. Images whose longer side exceeds 800
// pixels are reduced before the search, so that this side has 800 pixels. Dense corners are at whole pixels;
// their descriptors are not rotated and have a small fixed size. Distinct corners are at subpixel positions.
// Each of them has a size and a direction, and its descriptor is scaled and rotated accordingly.
enum class CornerKind { dense, distinct };
Corners find_corners(const View& view, CornerKind kind);

// Chooses, for each camera, at most `most` other cameras that probably see a similar part of the scene. These
// are the cameras with the nearest positions and the most similar viewing directions. Cameras at the same
// position, and cameras whose directions differ by 60 degrees or more, are not paired. Returns the pairs of
// indices, sorted and without duplicates.
std::vector<std::pair<std::size_t, std::size_t>> neighbours(std::span<const Camera> cameras,
                                                            std::size_t most);

// Returns, for each corner of `from`, the index of the corner of `to` with the most similar descriptor. Only
// corners of `to` near the epipolar line are considered. Their distance from this line is at most `band`
// pixels of the searched image of `to`. Returns -1 for a corner if there are none, or if the second most
// similar descriptor is nearly as similar.
std::vector<std::ptrdiff_t> best_along_lines(const Corners& from, const Corners& to, double band);

// Transforms a point from world space to the space of the camera.
Vec3 in_camera(const Camera& camera, const Vec3& point);
// Returns the position of the projected point [px], which may be outside of the image, or nullopt if the
// point is not in front of the camera.
std::optional<Pixel> seen_at(const Camera& camera, const Vec3& point);

// Returns the index of the pixel that contains `at`, or of the nearest pixel if `at` is outside of the image.
inline std::size_t pixel_index(const Image8& image, const Pixel& at) {
  const int x = std::clamp(static_cast<int>(at[0]), 0, image.width - 1);
  const int y = std::clamp(static_cast<int>(at[1]), 0, image.height - 1);
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
}

// Tracks is a union-find structure over the corners of all images. A track is a set of corners that show the
// same scene point, and is identified by the smallest index of its corners.
class Tracks {
 public:
  explicit Tracks(std::size_t corners) : parent_(corners) { std::iota(parent_.begin(), parent_.end(), 0); }
  // Returns the track of corner k.
  std::size_t of(std::size_t k) {
    while (parent_[k] != k) k = parent_[k] = parent_[parent_[k]];
    return k;
  }
  void join(std::size_t a, std::size_t b) { parent_[std::max(of(a), of(b))] = std::min(of(a), of(b)); }

 private:
  std::vector<std::size_t> parent_;
};

}  // namespace ubs
