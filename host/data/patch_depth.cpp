// SPDX-License-Identifier: Apache-2.0
// See patch_depth.hpp.
#include "host/data/patch_depth.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/vector3.hpp"

namespace ubs {
namespace {

// Minimum standard deviation of a patch; a patch with less contrast cannot be recognised in another image.
constexpr double kMinContrast = 2;

}  // namespace

float GreyPicture::at(double column, double row) const {
  const double u = column / across - 0.5, v = row / down - 0.5;
  if (!(u >= 0 && v >= 0 && u < width - 1 && v < height - 1)) return -1;
  const int c = static_cast<int>(u), r = static_cast<int>(v);
  const auto s = static_cast<float>(u - c), t = static_cast<float>(v - r);
  const float* const top = values.data() + std::ptrdiff_t{r} * width + c;
  const float* const low = top + width;
  return (1 - t) * ((1 - s) * top[0] + s * top[1]) + t * ((1 - s) * low[0] + s * low[1]);
}

bool Patch::normalise(Values& values) {
  float sum = 0, squares = 0;
  for (const float v : values) sum += v;
  const float mean = sum / static_cast<float>(values.size());
  for (float& v : values) v -= mean, squares += v * v;
  if (!(squares > static_cast<float>(kMinContrast * kMinContrast * kSide * kSide))) return false;
  const float scale = 1 / std::sqrt(squares);
  for (float& v : values) v *= scale;
  return true;
}

Patch::Patch(const GreyPicture& from, const Pixel& at)
    : from_(from), corner_{at[0] - kSide / 2 * from.across, at[1] - kSide / 2 * from.down} {
  for (std::size_t i = 0; i < values_.size(); ++i) {
    values_[i] = from.at(corner_[0] + static_cast<double>(i % kSide) * from.across,
                         corner_[1] + static_cast<double>(i / kSide) * from.down);
    if (values_[i] < 0) return;
  }
  plain_ = !normalise(values_);
}

double Patch::agreement(const GreyPicture& other, double depth) const {
  if (plain_) return -1;
  const Camera &a = from_.camera, &b = other.camera;
  // The corner of the patch, and one step along its rows and columns, in the coordinates of the other camera.
  const Vec3 local[3] = {{(corner_[0] - a.cx) / a.fx * depth, (corner_[1] - a.cy) / a.fy * depth, depth},
                         {from_.across / a.fx * depth, 0, 0},
                         {0, from_.down / a.fy * depth, 0}};
  const RotationMatrix back = transposed(a.rotation);
  const Vec3 there[3] = {rotated(b.rotation, rotated(back, local[0] - a.translation)) + b.translation,
                         rotated(b.rotation, rotated(back, local[1])),
                         rotated(b.rotation, rotated(back, local[2]))};
  Values seen;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const Vec3 p =
        there[0] + static_cast<double>(i % kSide) * there[1] + static_cast<double>(i / kSide) * there[2];
    if (!(p[2] > 0)) return -1;
    seen[i] = other.at(b.fx * p[0] / p[2] + b.cx, b.fy * p[1] / p[2] + b.cy);
    if (seen[i] < 0) return -1;
  }
  if (!normalise(seen)) return -1;
  float sum = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) sum += values_[i] * seen[i];
  return sum;
}

std::optional<double> Patch::best_depth(std::span<const GreyPicture* const> others, double near, double far,
                                        int count, double least) const {
  if (plain_ || others.empty()) return std::nullopt;
  std::optional<double> best;
  for (int i = 0; i < count; ++i) {
    const double depth = 1 / (1 / far + (1 / near - 1 / far) * i / (count - 1));
    double first = -1, second = -1;
    for (const GreyPicture* other : others) {
      const double found = agreement(*other, depth);
      second = std::max(second, std::min(first, found));
      first = std::max(first, found);
    }
    if (const double mean = others.size() > 1 ? (first + second) / 2 : first; mean > least)
      least = mean, best = depth;
  }
  return best;
}

}  // namespace ubs
