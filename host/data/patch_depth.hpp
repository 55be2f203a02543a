// SPDX-License-Identifier: Apache-2.0
// Patch estimates the depth of a pixel from other images: at the correct depth, they show the same patch of
// pixels.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs {

using Pixel = std::array<double, 2>;  // column, row; the first pixel is [0, 1] x [0, 1]

// The image of a view in grey [0, 255]. It may be smaller than the view: one of its pixels covers `across` x
// `down` pixels of the camera.
struct GreyPicture {
  Camera camera;
  int width = 0, height = 0;
  std::vector<float> values;  // row by row
  double across = 1, down = 1;

  // Interpolates linearly between pixels; returns -1 outside of the image.
  float at(double column, double row) const;
};

// The pixels around a pixel of an image, with their mean subtracted and scaled to unit length.
class Patch {
 public:
  // `at` is a pixel position of the camera.
  Patch(const GreyPicture& from, const Pixel& at);

  // Returns whether the patch cannot be matched: it has too little contrast or is partly outside of the
  // image.
  bool plain() const { return plain_; }
  // Returns the correlation, at most 1, with the image that `other` shows of this patch, if the patch faces
  // this camera at `depth`. Returns -1 if `other` does not show the whole patch or has too little contrast
  // there.
  double agreement(const GreyPicture& other, double depth) const {
    return agreement(projected(other), depth);
  }
  // Tries `count` depths, evenly spaced in 1/depth, and returns the depth with the highest agreement. The
  // agreement of a depth is the mean of the agreements with the two best images of `others`, or the agreement
  // with the only image. Returns nothing if no agreement is above `least`.
  std::optional<double> best_depth(std::span<const GreyPicture* const> others, double near, double far,
                                   int count, double least) const;

 private:
  static constexpr int kSide = 7;  // [pixels of the image]
  using Values = std::array<float, kSide * kSide>;
  // The positions of the patch's pixels in another image, without the part that depends on the depth.
  struct Projected {
    const GreyPicture* picture;
    std::array<Values, 3> samples;
    std::array<float, 3> shift;
  };
  static bool normalise(Values& values);
  Projected projected(const GreyPicture& other) const;
  double agreement(const Projected& other, double depth) const;

  const GreyPicture& from_;
  Pixel corner_;  // corner of the patch
  Values values_{};
  bool plain_ = true;
};

}  // namespace ubs
