// SPDX-License-Identifier: Apache-2.0
// Patch estimates the depth of a pixel. For each candidate depth, it compares the pixels around this pixel
// with the pixels of other images that show the same place if the depth is correct.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs {

using Pixel = std::array<double, 2>;  // column, row; the first pixel is [0, 1] x [0, 1]

// GreyPicture is a grey image of a view, with values from 0 to 255. It may be smaller than the view: one of
// its pixels covers `across` x `down` pixels of the camera.
struct GreyPicture {
  Camera camera;
  int width = 0, height = 0;
  std::vector<float> values;  // row by row
  double across = 1, down = 1;

  // Returns the value at a position in pixels of the camera, interpolated linearly between the pixels of this
  // image, or -1 if the position is not between the centres of four pixels.
  float at(double column, double row) const;
};

// Patch contains the values of the pixels around a pixel of an image. Their mean is subtracted, and they are
// scaled to a vector of unit length.
class Patch {
 public:
  // `at` is the position of the centre of the patch, in pixels of the camera. `from` must outlive the patch.
  Patch(const GreyPicture& from, const Pixel& at);

  // Returns whether the patch cannot be matched, because it has too little contrast or is partly outside of
  // the image.
  bool plain() const { return plain_; }
  // Returns the correlation, from -1 to 1, between this patch and the pixels of `other` that show the same
  // surface if the surface is at `depth` and parallel to the image plane of this patch. Returns -1 if `other`
  // does not show the whole patch, or if its pixels have too little contrast there.
  double agreement(const GreyPicture& other, double depth) const {
    return agreement(projected(other), depth);
  }
  // Tries `count` depths from `near` to `far`, evenly spaced in 1/depth, and returns the depth with the
  // highest agreement. The agreement of a depth is the mean of the agreements with the two best images of
  // `others`, or the agreement with the only image. Returns nullopt if no agreement is above `least`, if
  // `others` is empty, or if the patch is plain.
  std::optional<double> best_depth(std::span<const GreyPicture* const> others, double near, double far,
                                   int count, double least) const;

 private:
  static constexpr int kSide = 7;  // side of a patch [pixels of the image]
  using Values = std::array<float, kSide * kSide>;
  // Projected describes the positions of the patch's pixels in another image. The homogeneous position of a
  // pixel at the depth d is its entry in `samples`, plus shift / d.
  struct Projected {
    const GreyPicture* picture;
    std::array<Values, 3> samples;
    std::array<float, 3> shift;
  };
  static bool normalise(Values& values);
  Projected projected(const GreyPicture& other) const;
  double agreement(const Projected& other, double depth) const;

  const GreyPicture& from_;
  Pixel corner_;  // position of the first pixel of the patch, in pixels of the camera
  Values values_{};
  bool plain_ = true;
};

}  // namespace ubs
