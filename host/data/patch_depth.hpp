// SPDX-License-Identifier: Apache-2.0
// How far away a pixel is, from other pictures: at the right depth they show the patch of pixels about it.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs {

using Pixel = std::array<double, 2>;  // column, row; the first pixel lies in [0, 1] x [0, 1]

// A view's picture in grey [0, 255], perhaps smaller than the view: one of its pixels has the size of
// across x down pixels of the camera.
struct GreyPicture {
  Camera camera;
  int width = 0, height = 0;
  std::vector<float> values;  // row by row
  double across = 1, down = 1;

  // Between pixels linearly; -1 outside.
  float at(double column, double row) const;
};

// The pixels about one of a picture, without their mean and of unit length.
class Patch {
 public:
  // Pixel `at` of the camera.
  Patch(const GreyPicture& from, const Pixel& at);

  // Too little contrast to be found again, or not wholly in the picture.
  bool plain() const { return plain_; }
  // Correlation, at most 1, with what `other` shows of a patch that faces this camera at `depth`; -1 where
  // that is plain.
  double agreement(const GreyPicture& other, double depth) const;
  // Of `count` depths, evenly spaced in 1/depth, the one where the best two of `others`, or the one, agree
  // most; none where they agree less than `least` at every depth.
  std::optional<double> best_depth(std::span<const GreyPicture* const> others, double near, double far,
                                   int count, double least) const;

 private:
  static constexpr int kSide = 7;  // [pixels of the picture]
  using Values = std::array<float, kSide * kSide>;
  static bool normalise(Values& values);

  const GreyPicture& from_;
  Pixel corner_;  // of the patch
  Values values_{};
  bool plain_ = true;
};

}  // namespace ubs
