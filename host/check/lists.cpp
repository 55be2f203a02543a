// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cstring>

#include "host/check/stage_checks.hpp"
#include "host/check/tile_lists.hpp"

namespace ubs::check {
namespace {

// Number of splats in the lists. It is so large that the scan and the sort process several full blocks, which
// have 2048 or more elements, and an incomplete block.
constexpr std::uint32_t kListedSplats = 9001;

// Returns the number of words that differ.
double differing(const Words& found, const Words& expected) {
  double count = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) count += found[i] != expected[i];
  return count;
}

// Buffers for the inputs and the outputs of the list operations.
struct ListsOnDevice {
  ListsOnDevice(Device& device, const ListedSplats& splats, std::size_t room)
      : counts(device, "tile counts", splats.counts.size()),
        keys(device, "depth keys", splats.keys.size()),
        rects(device, "tile rects", splats.rects.size()),
        offsets(device, "slot offsets", splats.keys.size()),
        ids(device, "sorted splats", room),
        slots(device, "sorted slots", room),
        ranges(device, "tile ranges", static_cast<std::size_t>(splats.shape.tiles()) + 1),
        totals(device, "list totals", 2) {
    counts.upload(splats.counts);
    keys.upload(splats.keys);
    rects.upload(splats.rects);
  }
  Buffer<std::uint32_t> counts, keys, rects, offsets, ids, slots, ranges;
  Buffer<std::uint64_t> totals;
};

// Checks the lists of the splats. If `bounded` is set, the lists are built in buffers of a given size,
// without waiting for the number of intersections.
Finding check(Device& device, Stages& stages, const ListedSplats& splats, const TileLists& expected,
              bool bounded) {
  const std::uint64_t pairs = expected.totals.intersections, room = bounded ? pairs + pairs / 3 : pairs;
  ListsOnDevice on(device, splats, room);
  CountLists count{splats.count(), on.counts.view(), on.keys.view(), on.offsets.view()};
  if (bounded) {
    count.totals = on.totals.view();
    count.room = {(expected.totals.visible + splats.count()) / 2, room};
  }
  ListTotals totals = stages.count_lists(count);
  WorstFinding worst(bounded ? "lists of bounded size" : "lists");
  const ListTotals given = totals;
  if (bounded) {
    std::array<std::uint64_t, 2> counted{};
    const auto read = device.read_later(*on.totals.view().memory, 0, sizeof counted);
    std::memcpy(counted.data(), read->wait().data(), sizeof counted);
    totals = {counted[0], counted[1]};
  }
  worst.add("error of the number of visible splats",
            static_cast<double>(std::max(totals.visible, expected.totals.visible) -
                                std::min(totals.visible, expected.totals.visible)),
            0);
  worst.add(
      "error of the number of intersections",
      static_cast<double>(std::max(totals.intersections, pairs) - std::min(totals.intersections, pairs)), 0);
  // If the numbers are wrong, the lists are not built, because they might not fit into the buffers.
  if (!worst.finding().holds()) return worst.finding();
  stages.build_lists({splats.count(), given, splats.shape, on.keys.view(), on.rects.view(), on.offsets.view(),
                      on.ids.view(), on.slots.view(), on.ranges.view(), bounded});
  if (stages.config().backward) {
    worst.add("wrong prefix sums", differing(on.offsets.download(), expected.offsets), 0);
    worst.add("wrong slots", differing(on.slots.download(), expected.slots), 0);
  }
  worst.add("wrong tile ranges", differing(on.ranges.download(), expected.ranges), 0);
  worst.add("wrong splat indices", differing(on.ids.download(), expected.ids), 0);
  return worst.finding();
}

}  // namespace

Findings check_lists(Device& device, Stages& stages) {
  Random random(20);
  const ListedSplats splats = made_up_splats(random, kListedSplats, 333, 77, 0.6, 5);
  const TileLists expected = expected_lists(splats);
  Findings all{check(device, stages, splats, expected, false)};
  if (stages.config().backward) all.push_back(check(device, stages, splats, expected, true));
  return all;
}

}  // namespace ubs::check
