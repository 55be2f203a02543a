// SPDX-License-Identifier: Apache-2.0
// This file contains the methods of Renderer for views whose splats are projected by one process and whose
// image is rendered by another process.
#include <algorithm>
#include <array>

#include "host/pipeline/renderer.hpp"

namespace ubs {

std::uint32_t Renderer::project_only(const SplatView& splats, std::uint32_t camera,
                                     const RenderSettings& settings, VisibleSplats& drawn) {
  if (splats.count == 0) return 0;
  const RenderGroup group{&stages_, splats};
  choose(std::span(&group, 1), camera, settings, false);
  project(true);
  reserve(device_, drawn.places, "indices of drawn splats", count_ + std::size_t{1});
  const std::uint32_t count = stages_.place_drawn(
      {.count = count_, .tile_counts = tile_counts_.view(), .places = drawn.places.view()});
  reserve(device_, drawn.rows, "drawn splats", std::size_t{count} * kSplatStride);
  stages_.pick_drawn({.count = count_,
                      .records = records_.view(),
                      .tile_rects = tile_rects_.view(),
                      .places = drawn.places.view(),
                      .drawn = drawn.rows.view()});
  return count;
}

Buffer<float>& Renderer::drawn_records(std::uint32_t drawn, bool for_backward) {
  reserve_splats(std::max(drawn, 1u), for_backward);
  return records_;
}

// Splats that are not visible do not intersect any tile. So the lists, the slots and the sums are the same as
// if all splats were present. If no splat is visible, the view is rendered with a single splat that is not
// visible, because the operations need at least one.
ListTotals Renderer::forward_projected(std::uint32_t drawn, std::uint32_t camera,
                                       const RenderSettings& settings, bool for_backward) {
  choose({}, camera, settings, for_backward);
  reserve_image(for_backward);
  count_ = std::max(drawn, 1u);
  if (drawn == 0) {
    depth_keys_.upload(std::array{std::uint32_t{UBS_KEY_CULLED}});
    tile_counts_.upload(std::array{std::uint32_t{0}});
  }
  stages_.unpack_drawn({.count = drawn,
                        .records = records_.view(),
                        .depth_keys = depth_keys_.view(),
                        .tile_rects = tile_rects_.view(),
                        .tile_counts = tile_counts_.view()});
  return list_counted(for_backward);
}

void Renderer::take_gradient(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                             const VisibleSplats& drawn) {
  const RenderGroup group{&stages_, splats};
  choose(std::span(&group, 1), camera, settings, true);
  count_ = splats.count;
  reserve_splats(splats.stride, true);
  stages_.spread_gradient({.count = count_,
                           .drawn = drawn.rows.view(),
                           .places = drawn.places.view(),
                           .v_records = v_records_.view()});
}

}  // namespace ubs
