// SPDX-License-Identifier: Apache-2.0
// See patch_depth.hpp.
#include "host/dataset/patch_depth.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/vector3.hpp"

namespace ubs {
namespace {

// Minimum standard deviation of the grey values of a patch. A patch with less contrast cannot be recognised
// in another image.
constexpr double kMinContrast = 2;

// Interpolates between four pixels: `top`, its right neighbour, and the two pixels below them. `across` and
// `down` are the position between these pixels, from 0 to 1.
float interpolated(const float* top, int width, float across, float down) {
  const float* const low = top + width;
  const float upper = top[0] + across * (top[1] - top[0]), lower = low[0] + across * (low[1] - low[0]);
  return upper + down * (lower - upper);
}

}  // namespace

float GreyPicture::at(double column, double row) const {
  const double u = column / across - 0.5, v = row / down - 0.5;
  if (!(u >= 0 && v >= 0 && u < width - 1 && v < height - 1)) return -1;
  const int c = static_cast<int>(u), r = static_cast<int>(v);
  return interpolated(values.data() + std::ptrdiff_t{r} * width + c, width, static_cast<float>(u - c),
                      static_cast<float>(v - r));
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

// Computes the projection of the samples of the patch. A sample at the depth d has the homogeneous position
// (x, y, z) + shift / d in the image of another camera, where (x, y, z) and `shift` do not depend on d.
Patch::Projected Patch::projected(const GreyPicture& other) const {
  const Camera &a = from_.camera, &b = other.camera;
  const RotationMatrix back = transposed(a.rotation);
  const auto in_other = [&](const Vec3& in_a) { return rotated(b.rotation, rotated(back, in_a)); };
  const auto in_pixels = [&](const Vec3& p) {
    return Vec3{(b.fx * p[0] + b.cx * p[2]) / other.across - 0.5 * p[2],
                (b.fy * p[1] + b.cy * p[2]) / other.down - 0.5 * p[2], p[2]};
  };
  // These are the corner of the patch, a step of one pixel along its rows, and a step of one pixel along its
  // columns, all at depth 1.
  const Vec3 corner = in_pixels(in_other({(corner_[0] - a.cx) / a.fx, (corner_[1] - a.cy) / a.fy, 1}));
  const Vec3 along = in_pixels(in_other({from_.across / a.fx, 0, 0}));
  const Vec3 down = in_pixels(in_other({0, from_.down / a.fy, 0}));
  const Vec3 shift = in_pixels(b.translation - in_other(a.translation));
  Projected out{&other, {}, {}};
  for (std::size_t k = 0; k < 3; ++k) {
    out.shift[k] = static_cast<float>(shift[k]);
    for (std::size_t i = 0; i < values_.size(); ++i)
      out.samples[k][i] = static_cast<float>(corner[k] + static_cast<double>(i % kSide) * along[k] +
                                             static_cast<double>(i / kSide) * down[k]);
  }
  return out;
}

double Patch::agreement(const Projected& other, double depth) const {
  if (plain_) return -1;
  const GreyPicture& picture = *other.picture;
  const auto inverse = static_cast<float>(1 / depth);
  const float x = other.shift[0] * inverse, y = other.shift[1] * inverse, z = other.shift[2] * inverse;
  // The positions are computed in a separate loop, because the compiler vectorises such simple loops.
  Values columns, rows;
  int outside = 0;
  const auto right = static_cast<float>(picture.width - 1), bottom = static_cast<float>(picture.height - 1);
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const float w = other.samples[2][i] + z, inverse_w = 1 / w;
    const float column = (other.samples[0][i] + x) * inverse_w, row = (other.samples[1][i] + y) * inverse_w;
    columns[i] = column, rows[i] = row;
    outside |= !(w > 0) | !(column >= 0) | !(row >= 0) | !(column < right) | !(row < bottom);
  }
  if (outside != 0) return -1;
  std::array<int, kSide * kSide> first;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const int c = static_cast<int>(columns[i]), r = static_cast<int>(rows[i]);
    columns[i] -= static_cast<float>(c), rows[i] -= static_cast<float>(r);
    first[i] = r * picture.width + c;
  }
  Values seen;
  for (std::size_t i = 0; i < seen.size(); ++i)
    seen[i] = interpolated(picture.values.data() + first[i], picture.width, columns[i], rows[i]);
  if (!normalise(seen)) return -1;
  float sum = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) sum += values_[i] * seen[i];
  return sum;
}

std::optional<double> Patch::best_depth(std::span<const GreyPicture* const> others, double near, double far,
                                        int count, double least) const {
  if (plain_ || others.empty()) return std::nullopt;
  std::vector<Projected> views;
  for (const GreyPicture* other : others) views.push_back(projected(*other));
  std::optional<double> best;
  for (int i = 0; i < count; ++i) {
    const double depth = 1 / (1 / far + (1 / near - 1 / far) * i / (count - 1));
    double first = -1, second = -1;
    for (const Projected& view : views) {
      const double found = agreement(view, depth);
      second = std::max(second, std::min(first, found));
      first = std::max(first, found);
    }
    if (const double mean = others.size() > 1 ? (first + second) / 2 : first; mean > least)
      least = mean, best = depth;
  }
  return best;
}

}  // namespace ubs
