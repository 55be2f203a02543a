// SPDX-License-Identifier: Apache-2.0
// See change_bound.hpp.
#include "host/reduce/change_bound.hpp"

#include <algorithm>
#include <cmath>

#include "kernels/layout.h"

namespace ubs::reduce {

struct ChangeBound::Lists {
  RasterForward views;
  std::vector<std::uint32_t> ids, ranges, counts;
  std::vector<float> records;
};

namespace {

constexpr std::uint32_t kNowhere = 0xffffffffu;

struct Planes {
  std::vector<float> changes, stops;
};

struct ColourRange {
  std::array<float, 3> low, high;
  void add(const float* colour) {
    for (std::size_t c = 0; c < 3; ++c) {
      low[c] = std::min(low[c], colour[c]);
      high[c] = std::max(high[c], colour[c]);
    }
  }
};

// Of all colours that the background has. No harmonic of a sky is larger than that of 2 z^2 - x^2 - y^2 along
// z.
ColourRange background_range(const RenderSettings& render) {
  constexpr float kLargest = 0.6308f;
  ColourRange range{render.background, render.background};
  for (std::size_t i = 3; render.sky && i < render.sky->size(); ++i) {
    const float most = kLargest * std::abs((*render.sky)[i]);
    range.low[i % 3] -= most;
    range.high[i % 3] += most;
  }
  return range;
}

}  // namespace

ChangeBound::ChangeBound(Device& device, const Reduced& reduced)
    : device_(device),
      reduced_(reduced),
      old_index_(reduced.model.count()),
      place_(reduced.new_index.size()),
      stamp_(reduced.new_index.size(), kNowhere),
      partners_(device, "partners", 1),
      changes_(device, "change of pixels", 1),
      stops_(device, "finished pixels", 1) {
  for (std::size_t i = 0; i < reduced.new_index.size(); ++i)
    if (reduced.new_index[i] != kGone) old_index_[reduced.new_index[i]] = static_cast<std::uint32_t>(i);
}

ChangeBound::Lists ChangeBound::download(const Renderer& renderer, std::size_t splats) const {
  Lists lists;
  lists.views = renderer.last_lists();
  lists.ranges =
      read_values(device_, lists.views.tile_ranges, static_cast<std::size_t>(lists.views.shape.tiles()) + 1);
  lists.ids = read_values(device_, lists.views.sorted_ids, renderer.intersections());
  lists.counts = read_values(device_, renderer.tile_counts(), splats);
  lists.records = read_values(device_, lists.views.records, splats * kSplatStride);
  return lists;
}

// Partners by place in the lists of both models, tile by tile.
void ChangeBound::mark(const Lists& before, const Lists& after, std::size_t tiles) {
  partners_before_.assign(before.ids.size(), UBS_PARTNER_SAME);
  partners_after_.assign(after.ids.size(), UBS_PARTNER_SAME);
  std::ranges::fill(stamp_, kNowhere);
  std::vector<std::uint32_t> places, ends;  // of the splats in both lists: places in the first, in the second
  for (std::uint32_t tile = 0; tile < tiles; ++tile) {
    for (std::uint32_t at = before.ranges[tile]; at < before.ranges[tile + 1]; ++at) {
      const std::uint32_t old = before.ids[at], now = reduced_.new_index[old];
      place_[old] = at;
      stamp_[old] = tile;
      if (now == kGone || (reduced_.turned[old] && after.counts[now] == 0))
        partners_before_[at] = UBS_PARTNER_NONE;
      else if (reduced_.turned[old])
        partners_before_[at] = now;
    }
    places.clear();
    ends.clear();
    for (std::uint32_t at = after.ranges[tile]; at < after.ranges[tile + 1]; ++at) {
      const std::uint32_t old = old_index_[after.ids[at]];
      if (stamp_[old] != tile) {
        partners_after_[at] = UBS_PARTNER_NONE;  // it comes into the tile
      } else {
        places.push_back(place_[old]);
        ends.push_back(at);
      }
    }
    // Turned splats that are in front of something they were behind, or the reverse.
    std::uint32_t highest = 0;
    std::vector<std::uint32_t> lowest(places.size() + 1, kNowhere);
    for (std::size_t k = places.size(); k-- > 0;) lowest[k] = std::min(lowest[k + 1], places[k]);
    for (std::size_t k = 0; k < places.size(); ++k) {
      const bool moved = (k > 0 && highest > places[k]) || lowest[k + 1] < places[k];
      if (moved && reduced_.turned[old_index_[after.ids[ends[k]]]])
        partners_before_[places[k]] = partners_after_[ends[k]] = UBS_PARTNER_NONE;
      highest = std::max(highest, places[k]);
    }
  }
}

ViewChange ChangeBound::compare(Stages& before_stages, const Renderer& before, Stages& after_stages,
                                const Renderer& after, const RenderSettings& render) {
  const Lists a = download(before, reduced_.new_index.size()), b = download(after, old_index_.size());
  const ImageShape shape = a.views.shape;
  const std::size_t plane = shape.plane(), tiles = static_cast<std::size_t>(shape.tiles());
  mark(a, b, tiles);

  const auto measure = [&](Stages& stages, const Lists& lists, const std::vector<std::uint32_t>& partners,
                           BufferView<float> others) {
    partners_.reserve(lists.views.sorted_ids.size);
    if (!partners.empty()) partners_.upload(partners);
    changes_.reserve(plane);
    stops_.reserve(plane);
    stages.measure_weights({.shape = shape,
                            .records = lists.views.records,
                            .sorted_ids = lists.views.sorted_ids,
                            .sorted_slots = lists.views.sorted_slots,
                            .tile_ranges = lists.views.tile_ranges,
                            .masks = lists.views.masks,
                            .partners = partners_.view(),
                            .others = others,
                            .changes = changes_.view(),
                            .stops = stops_.view()});
    return Planes{read_values(device_, changes_.view(), plane), read_values(device_, stops_.view(), plane)};
  };
  const Planes first = measure(before_stages, a, partners_before_, b.views.records);
  const Planes second = measure(after_stages, b, partners_after_, a.views.records);
  const std::vector<float> image_a = read_values(device_, a.views.image, 3 * plane),
                           image_b = read_values(device_, b.views.image, 3 * plane);

  const ColourRange behind = background_range(render);
  ViewChange out;
  out.identical = true;
  // Kernels of other dimensions may round a turned splat differently where its change is none.
  const bool rounds_differ = std::ranges::find(reduced_.turned, true) != reduced_.turned.end();
  const std::size_t pitch = static_cast<std::size_t>(shape.pitch());
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    ColourRange range = behind;
    for (const Lists* lists : {&a, &b})
      for (std::uint32_t at = lists->ranges[tile]; at < lists->ranges[tile + 1]; ++at)
        range.add(&lists->records[static_cast<std::size_t>(lists->ids[at]) * kSplatStride + kSplatR]);
    const int left = static_cast<int>(tile) % shape.tiles_x() * kTileSide;
    const int top = static_cast<int>(tile) / shape.tiles_x() * kTileSide;
    for (int y = top; y < std::min(top + kTileSide, shape.height); ++y)
      for (int x = left; x < std::min(left + kTileSide, shape.width); ++x) {
        const std::size_t p = static_cast<std::size_t>(y) * pitch + static_cast<std::size_t>(x);
        const double change = static_cast<double>(first.changes[p]) + second.changes[p];
        const double stop = std::max(first.stops[p], second.stops[p]);
        const double weight = change > 0 ? change + (stop > 0 ? stop + change : 0) : 0;
        for (std::size_t c = 0; c < 3; ++c) {
          const float va = image_a[c * plane + p], vb = image_b[c * plane + p];
          const double measured = std::abs(static_cast<double>(va) - vb);
          const double bound =
              weight * (range.high[c] - range.low[c]) + (weight > 0 || rounds_differ ? kRounding : 0);
          out.identical = out.identical && va == vb;
          ++out.values;
          out.measured_max = std::max(out.measured_max, measured);
          out.bound_max = std::max(out.bound_max, bound);
          out.measured_rms += measured * measured;
          out.bound_rms += bound * bound;
          if (!(measured <= bound)) ++out.beyond_bound;
          if (bound > 0) out.worst_ratio = std::max(out.worst_ratio, measured / bound);
        }
      }
  }
  out.measured_rms = std::sqrt(out.measured_rms / static_cast<double>(out.values));
  out.bound_rms = std::sqrt(out.bound_rms / static_cast<double>(out.values));
  return out;
}

}  // namespace ubs::reduce
