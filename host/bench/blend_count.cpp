// SPDX-License-Identifier: Apache-2.0
#include "host/bench/blend_count.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <span>
#include <vector>

#include "host/base/parallel.hpp"
#include "kernels/layout.h"
#define R(x) x##f  // limits of the kernels, in single precision
#include "kernels/limits.h"

namespace ubs::bench {
namespace {

constexpr int kMaxTile = 16, kBlock = 4;
constexpr float kGaussianSupport = 9;
constexpr int kObjectThreshold = 3;
constexpr double kLongList = 4;  // times the mean

template <typename T>
std::vector<T> download(Device& device, const BufferView<T>& view, std::size_t count) {
  std::vector<T> values(std::min(count, view.size));
  if (!values.empty()) device.read(*view.memory, 0, std::as_writable_bytes(std::span(values)));
  return values;
}

struct Lists {
  std::vector<float> records;
  std::vector<std::uint32_t> ids, slots, ranges;
  std::vector<std::uint16_t> masks;
  float alpha_min = 0;
  bool gaussian = false;
};

class TileCounter {
 public:
  TileCounter(const Lists& lists, const ImageShape& shape, int tile)
      : lists_(lists),
        side_(shape.tile),
        x0_(tile % shape.tiles_x() * shape.tile),
        y0_(tile / shape.tiles_x() * shape.tile) {
    open_.fill(1.0f);
    for (int p = 0; p < side_ * side_; ++p)
      if (x0_ + p % side_ >= shape.width || y0_ + p / side_ >= shape.height)
        open_[static_cast<std::size_t>(p)] = 0;
    const std::uint32_t first = lists.ranges[static_cast<std::size_t>(tile)],
                        last = lists.ranges[static_cast<std::size_t>(tile) + 1];
    for (std::uint32_t k = first; k < last; ++k) {
      add(lists.ids[k], lists.masks[lists.slots[k]]);
    }
  }
  WorkCounts counts() const {
    WorkCounts c = counts_;
    for (const std::uint32_t n : blended_) {
      c.blended += n;
      if (n <= kObjectThreshold) continue;
      ++c.object_pixels;
      c.object_blended += n;
    }
    return c;
  }

 private:
  void add(std::uint32_t splat, std::uint16_t mask) {
    if (mask == 0) return;
    ++counts_.active_pairs;
    counts_.blocks += static_cast<std::uint64_t>(std::popcount(mask));
    const float* s = &lists_.records[static_cast<std::size_t>(splat) * kSplatStride];
    const int across = side_ / kBlock;
    for (int block = 0; block < across * across; ++block)
      if (mask >> block & 1) add_block(s, block % across * kBlock, block / across * kBlock);
  }
  void add_block(const float* s, int bx, int by) {
    for (int y = by; y < by + kBlock; ++y)
      for (int x = bx; x < bx + kBlock; ++x) {
        const auto p = static_cast<std::size_t>(y * side_ + x);
        if (open_[p] == 0) continue;
        const float dx = s[kSplatX] - (static_cast<float>(x0_ + x) + 0.5f);
        const float dy = s[kSplatY] - (static_cast<float>(y0_ + y) + 0.5f);
        const float a = s[kSplatL00] * dx + s[kSplatL01] * dy, b = s[kSplatL11] * dy;
        const float r = a * a + b * b;
        const float alpha = lists_.gaussian ? gaussian_alpha(s, r) : beta_alpha(s, r);
        if (!(alpha > lists_.alpha_min)) continue;
        const float next = open_[p] * (1 - alpha);
        open_[p] = next > UBS_TRANSMITTANCE_MIN ? next : 0;
        if (open_[p] > 0) ++blended_[p];
      }
  }

  static float beta_alpha(const float* s, float r) {
    return r < 1 ? std::min(UBS_ALPHA_MAX, s[kSplatOpacity] * std::pow(1 - r, s[kSplatBeta])) : 0;
  }
  static float gaussian_alpha(const float* s, float r) {
    const float alpha = r < kGaussianSupport ? s[kSplatOpacity] * std::exp(-r / 2) : 0;
    return alpha >= UBS_ALPHA_MIN_GAUSSIAN ? std::min(UBS_ALPHA_MAX_GAUSSIAN, alpha) : 0;
  }

  const Lists& lists_;
  int side_, x0_, y0_;
  WorkCounts counts_;
  std::array<float, kMaxTile * kMaxTile> open_;
  std::array<std::uint32_t, kMaxTile * kMaxTile> blended_{};
};

double ratio(std::uint64_t a, std::uint64_t b) {
  return b ? static_cast<double>(a) / static_cast<double>(b) : 0;
}

}  // namespace

double WorkCounts::blended_per_pixel() const { return ratio(blended, pixels); }
double WorkCounts::blended_per_object_pixel() const { return ratio(object_blended, object_pixels); }
double WorkCounts::mean_list() const { return ratio(intersections, tiles); }
double WorkCounts::lane_utilisation() const { return ratio(blended, 16 * blocks); }
double WorkCounts::block_lanes_per_blended() const { return ratio(16 * blocks, blended); }

WorkCounts count_work(Device& device, const ParameterLayout& layout, std::uint64_t splats,
                      std::uint64_t visible, std::uint64_t intersections, const RasterForward& work,
                      float alpha_min) {
  const ImageShape& shape = work.shape;
  const Lists lists{download(device, work.records, splats * kSplatStride),
                    download(device, work.sorted_ids, intersections),
                    download(device, work.sorted_slots, intersections),
                    download(device, work.tile_ranges, static_cast<std::size_t>(shape.tiles()) + 1),
                    download(device, work.masks, intersections),
                    alpha_min,
                    layout.variant.kernel == SpatialKernel::gaussian};
  std::vector<WorkCounts> tiles(static_cast<std::size_t>(shape.tiles()));
  parallel_for(tiles.size(), [&](std::size_t tile) {
    tiles[tile] = TileCounter(lists, shape, static_cast<int>(tile)).counts();
  });
  WorkCounts sum;
  for (const WorkCounts& t : tiles) {
    sum.active_pairs += t.active_pairs;
    sum.blocks += t.blocks;
    sum.blended += t.blended;
    sum.object_pixels += t.object_pixels;
    sum.object_blended += t.object_blended;
  }
  sum.layout = layout;
  sum.splats = splats;
  sum.visible = visible;
  sum.intersections = intersections;
  sum.pixels = static_cast<std::uint64_t>(shape.width) * static_cast<std::uint64_t>(shape.height);
  sum.tiles = tiles.size();
  for (std::size_t tile = 0; tile < tiles.size(); ++tile) {
    const std::uint64_t length = lists.ranges[tile + 1] - lists.ranges[tile];
    sum.longest_list = std::max(sum.longest_list, length);
    if (static_cast<double>(length) > kLongList * sum.mean_list()) sum.long_pairs += length;
  }
  return sum;
}

}  // namespace ubs::bench
