// SPDX-License-Identifier: Apache-2.0
// See splat_series.hpp.
#include "host/formats/splat_series.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "host/base/parallel.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

using Quaternion = std::array<float, 4>;  // w x y z

Quaternion product_of(const Quaternion& a, const Quaternion& b) {
  return {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
          a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
          a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
          a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
}

float dot_of(const Quaternion& a, const Quaternion& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

// AxisTurn is a rotation that maps the coordinate axes onto each other. Axis k of the rotated frame is, apart
// from its sign, axis source[k] of the old frame.
struct AxisTurn {
  Quaternion turn;
  std::array<std::size_t, 3> source;
};

// Returns the 24 rotations of a cube. They are the products of quarter turns about x and about y.
std::vector<AxisTurn> axis_turns() {
  const float h = std::sqrt(0.5f);
  const AxisTurn about_x{{h, h, 0, 0}, {0, 2, 1}}, about_y{{h, 0, h, 0}, {2, 1, 0}};
  std::vector<AxisTurn> turns{{{1, 0, 0, 0}, {0, 1, 2}}};
  for (std::size_t t = 0; t < turns.size(); ++t)
    for (const AxisTurn& next : {about_x, about_y}) {
      AxisTurn both{product_of(turns[t].turn, next.turn), {}};
      for (std::size_t k = 0; k < 3; ++k) both.source[k] = turns[t].source[next.source[k]];
      const bool known = std::ranges::any_of(
          turns, [&](const AxisTurn& other) { return std::abs(dot_of(other.turn, both.turn)) > 0.99f; });
      if (!known) turns.push_back(both);
    }
  return turns;
}

// Permutes the axes of splat i so that its rotation is as close as possible to that of the previous time
// sample. The ellipsoid does not change. The axes are only permuted if the rotation becomes clearly closer.
// Then chooses the sign of the quaternion that is closer to the previous quaternion.
void name_axes_alike(const ImportedSplats& before, ImportedSplats& splats, std::size_t i,
                     std::span<const AxisTurn> turns) {
  constexpr float kClearlyNearer = 1e-4f;
  const Quaternion reference = before.rotations[i], old = splats.rotations[i];
  const std::array<float, 3> scales = splats.log_scales[i];
  float best = std::abs(dot_of(reference, old));
  for (const AxisTurn& turn : turns) {
    const Quaternion turned = product_of(old, turn.turn);
    const float likeness = std::abs(dot_of(reference, turned));
    if (likeness <= best + kClearlyNearer) continue;
    best = likeness;
    splats.rotations[i] = turned;
    for (std::size_t k = 0; k < 3; ++k) splats.log_scales[i][k] = scales[turn.source[k]];
  }
  if (dot_of(reference, splats.rotations[i]) < 0)
    for (float& q : splats.rotations[i]) q = -q;
}

template <typename Value>
void keep_marked(std::vector<Value>& values, const std::vector<char>& marks, std::size_t width = 1) {
  if (values.empty()) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < marks.size(); ++i) {
    if (!marks[i]) continue;
    for (std::size_t k = 0; k < width; ++k) values[kept * width + k] = values[i * width + k];
    ++kept;
  }
  values.resize(kept * width);
}

void keep_marked_splats(ImportedSplats& splats, const std::vector<char>& marks) {
  keep_marked(splats.positions, marks);
  keep_marked(splats.log_scales, marks);
  keep_marked(splats.rotations, marks);
  keep_marked(splats.opacity_logits, marks);
  keep_marked(splats.sh, marks, 3 * splats.coefficients());
}

}  // namespace

SplatSeries::SplatSeries(std::vector<ImportedSplats> moments) {
  for (ImportedSplats& splats : moments) add(std::move(splats));
}

void SplatSeries::add(ImportedSplats splats) {
  if (!moments_.empty() && splats.sh == moments_.front().sh) {
    splats.sh.clear();
    splats.sh.shrink_to_fit();
  }
  moments_.push_back(std::move(splats));
}

const std::vector<float>& SplatSeries::sh(std::span<const ImportedSplats> moments, std::size_t moment) {
  return moments[moment].sh.empty() ? moments.front().sh : moments[moment].sh;
}

ImportedSplats SplatSeries::moment(std::size_t moment) const {
  ImportedSplats splats = moments_[moment];
  splats.sh = sh(moment);
  return splats;
}

std::size_t SplatSeries::largest_count() const {
  std::size_t most = 0;
  for (const ImportedSplats& splats : moments_) most = std::max(most, splats.count());
  return most;
}

bool SplatSeries::finish(float least_opacity) {
  if (moments_.empty()) return true;
  const std::size_t count = moments_.front().count();
  if (std::ranges::any_of(moments_, [count](const ImportedSplats& s) { return s.count() != count; }))
    return false;
  const auto visible = [&](std::size_t moment, std::size_t i) {
    return sigmoid_of(moments_[moment].opacity_logits[i]) >= least_opacity;
  };
  std::vector<char> marks(count, 0);
  for (std::size_t m = 0; m < size(); ++m)
    for (std::size_t i = 0; i < count; ++i)
      if (visible(m, i)) marks[i] = 1;
  const std::vector<AxisTurn> turns = axis_turns();
  constexpr std::size_t kBlock = 1024;
  parallel_for((count + kBlock - 1) / kBlock, [&](std::size_t block) {
    std::vector<std::size_t> seen;
    for (std::size_t i = block * kBlock; i < std::min(count, (block + 1) * kBlock); ++i) {
      if (!marks[i]) continue;
      seen.clear();
      for (std::size_t m = 0; m < size(); ++m)
        if (visible(m, i)) seen.push_back(m);
      std::size_t nearest = 0;  // index in `seen` of the time sample that is nearest to m
      for (std::size_t m = 0; m < size(); ++m) {
        while (nearest + 1 < seen.size() && std::max(seen[nearest + 1], m) - std::min(seen[nearest + 1], m) <
                                                std::max(seen[nearest], m) - std::min(seen[nearest], m))
          ++nearest;
        if (const std::size_t from = seen[nearest]; from != m) {
          moments_[m].positions[i] = moments_[from].positions[i];
          moments_[m].log_scales[i] = moments_[from].log_scales[i];
          moments_[m].rotations[i] = moments_[from].rotations[i];
        }
      }
      for (std::size_t m = 1; m < size(); ++m) name_axes_alike(moments_[m - 1], moments_[m], i, turns);
    }
  });
  for (ImportedSplats& splats : moments_) keep_marked_splats(splats, marks);
  return true;
}

void SplatSeries::keep_apart() {
  for (std::size_t m = 1; m < size(); ++m) {
    ImportedSplats& splats = moments_[m];
    if (splats.count() != moments_[m - 1].count() || splats.count() == 0) continue;
    if (splats.sh.empty()) splats.sh = moments_.front().sh;
    splats.resize(splats.count() + 1);
    splats.positions.back() = splats.positions.front();
    splats.log_scales.back() = splats.log_scales.front();
    splats.rotations.back() = splats.rotations.front();
    splats.opacity_logits.back() = -kMaxLogit;
  }
}

}  // namespace ubs
