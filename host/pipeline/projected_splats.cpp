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
  const auto pick = [&](const std::uint32_t* rects, const float* records) {
    out.records.reserve(out.ids.size() * kSplatStride);
    for (const std::size_t i : out.ids) {
      const float* const record = records + i * kSplatStride;
      out.records.insert(out.records.end(), record, record + kSplatStride);
      float* const copy = &*(out.records.end() - kSplatStride);
      copy[kRectX] = std::bit_cast<float>(rects[2 * i]);
      copy[kRectY] = std::bit_cast<float>(rects[2 * i + 1]);
    }
  };
  tile_counts_.show(count_, rooms_[0], [&](const std::uint32_t* tiles) {
    for (std::uint32_t i = 0; i < count_; ++i)
      if (tiles[i] != 0) out.ids.push_back(i);
  });
  tile_rects_.show(std::size_t{2} * count_, rooms_[0], [&](const std::uint32_t* rects) {
    records_.show(std::size_t{kSplatStride} * count_, rooms_[1],
                  [&](const float* records) { pick(rects, records); });
  });
  return out;
}

// Splats that are not drawn have no tiles, so that lists, slots and sums are those of all splats in the same
// order. A view without any splat gets one that is not drawn.
ListTotals Renderer::forward_projected(std::span<const std::span<const float>> pieces, std::uint32_t camera,
                                       const RenderSettings& settings, bool for_backward) {
  choose({}, camera, settings, for_backward);
  reserve_image(for_backward);
  std::size_t splats = 0;
  for (const std::span<const float> piece : pieces) splats += piece.size() / kSplatStride;
  const std::size_t n = std::max<std::size_t>(splats, 1);
  count_ = static_cast<std::uint32_t>(n);
  reserve_splats(n, for_backward);
  std::vector<std::uint32_t> keys(n, UBS_KEY_CULLED), rects(2 * n), tiles(n);
  records_.fill(n * kSplatStride, rooms_[0], [&](float* to) {
    if (splats == 0) std::fill_n(to, std::size_t{kSplatStride}, 0.0f);
    std::size_t i = 0;
    for (const std::span<const float> piece : pieces) {
      std::ranges::copy(piece, to + i * kSplatStride);
      for (const std::size_t end = i + piece.size() / kSplatStride; i < end; ++i) {
        float* const record = to + i * kSplatStride;
        keys[i] = std::bit_cast<std::uint32_t>(record[kSplatDepth]);
        rects[2 * i] = std::bit_cast<std::uint32_t>(record[kRectX]);
        rects[2 * i + 1] = std::bit_cast<std::uint32_t>(record[kRectY]);
        tiles[i] = tiles_of(rects[2 * i], rects[2 * i + 1]);
        record[kRectX] = record[kRectY] = 0;
      }
    }
  });
  depth_keys_.upload(keys);
  tile_rects_.upload(rects);
  tile_counts_.upload(tiles);
  return list_counted(for_backward);
}

std::vector<float> Renderer::projected_gradient() {
  const std::size_t size = std::size_t{kGradStride} * count_;
  std::vector<float> rows;
  v_records_.show(size, rooms_[0], [&](const float* from) { rows.assign(from, from + size); });
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
  v_records_.fill(std::size_t{kGradStride} * count_, rooms_[0], [&](float* to) {
    const float* from = gradient.data();
    auto next = ids.begin();
    for (std::uint32_t i = 0; i < count_; ++i, to += kGradStride)
      if (next != ids.end() && *next == i) {
        std::copy_n(from, std::size_t{kGradStride}, to);
        from += kGradStride;
        ++next;
      } else {
        std::fill_n(to, std::size_t{kGradStride}, 0.0f);
      }
  });
}

}  // namespace ubs
