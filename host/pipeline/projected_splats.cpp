// SPDX-License-Identifier: Apache-2.0
// Renderer's parts of views that several processes make together. Records travel through the host: 64 bytes a
// splat that is drawn, with the tile rect in the two values that a record has to spare. What else the lists
// need follows from them.
#include <algorithm>
#include <bit>

#include "host/base/error.hpp"
#include "host/pipeline/renderer.hpp"

namespace ubs {
namespace {

constexpr std::size_t kRectX = kSplatReach + 1, kRectY = kRectX + 1;
static_assert(kRectY < kSplatStride);

std::uint32_t tiles_of(std::uint32_t rect_x, std::uint32_t rect_y) {
  const auto across = [](std::uint32_t from_to) { return (from_to >> 16) - (from_to & 0xffff) + 1; };
  return across(rect_x) * across(rect_y);
}

}  // namespace

ProjectedSplats Renderer::project_only(const SplatView& splats, std::uint32_t camera,
                                       const RenderSettings& settings) {
  ProjectedSplats out;
  if (splats.count == 0) return out;
  const RenderGroup group{&stages_, splats};
  choose(std::span(&group, 1), camera, settings, false);
  project(true);
  std::vector<std::uint32_t> tiles(count_), rects(std::size_t{2} * count_);
  std::vector<float> records(std::size_t{kSplatStride} * count_);
  tile_counts_.download(std::span<std::uint32_t>(tiles));
  tile_rects_.download(std::span<std::uint32_t>(rects));
  records_.download(std::span<float>(records));
  for (std::uint32_t i = 0; i < count_; ++i) {
    if (tiles[i] == 0) continue;
    const std::size_t at = out.records.size();
    out.ids.push_back(i);
    out.records.insert(out.records.end(), records.begin() + std::ptrdiff_t{kSplatStride} * i,
                       records.begin() + std::ptrdiff_t{kSplatStride} * (i + 1));
    out.records[at + kRectX] = std::bit_cast<float>(rects[2 * i]);
    out.records[at + kRectY] = std::bit_cast<float>(rects[2 * i + 1]);
  }
  return out;
}

// Splats that are not drawn have no tiles, so that lists, slots and sums are those of all splats in the same
// order. A view without any splat gets one that is not drawn.
ListTotals Renderer::forward_projected(std::span<const float> projected, std::uint32_t camera,
                                       const RenderSettings& settings, bool for_backward) {
  choose({}, camera, settings, for_backward);
  reserve_image(for_backward);
  std::vector<float> records(projected.begin(), projected.end());
  if (records.empty()) records.resize(kSplatStride);
  const std::size_t n = records.size() / kSplatStride;
  count_ = static_cast<std::uint32_t>(n);
  reserve_splats(n, for_backward);
  std::vector<std::uint32_t> keys(n, UBS_KEY_CULLED), rects(2 * n), tiles(n);
  for (std::size_t i = 0; i < projected.size() / kSplatStride; ++i) {
    float* record = &records[i * kSplatStride];
    keys[i] = std::bit_cast<std::uint32_t>(record[kSplatDepth]);
    rects[2 * i] = std::bit_cast<std::uint32_t>(record[kRectX]);
    rects[2 * i + 1] = std::bit_cast<std::uint32_t>(record[kRectY]);
    tiles[i] = tiles_of(rects[2 * i], rects[2 * i + 1]);
    record[kRectX] = record[kRectY] = 0;
  }
  records_.upload(records);
  depth_keys_.upload(keys);
  tile_rects_.upload(rects);
  tile_counts_.upload(tiles);
  return list_counted(for_backward);
}

std::vector<float> Renderer::projected_gradient() const {
  std::vector<float> rows(std::size_t{kGradStride} * count_);
  v_records_.download(std::span<float>(rows));
  return rows;
}

void Renderer::take_gradient(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                             std::span<const std::uint32_t> ids, std::span<const float> gradient) {
  if (gradient.size() < ids.size() * kGradStride)
    fail(ErrorKind::internal, "{} values of gradient for {} splats", gradient.size(), ids.size());
  const RenderGroup group{&stages_, splats};
  choose(std::span(&group, 1), camera, settings, true);
  count_ = splats.count;
  reserve_splats(splats.stride, true);
  std::vector<float> rows(std::size_t{kGradStride} * count_);
  for (std::size_t i = 0; i < ids.size(); ++i)
    std::copy_n(gradient.begin() + static_cast<std::ptrdiff_t>(i * kGradStride), std::size_t{kGradStride},
                rows.begin() + std::ptrdiff_t{kGradStride} * ids[i]);
  v_records_.upload(rows);
}

}  // namespace ubs
