// SPDX-License-Identifier: Apache-2.0
// Tests the lists of splats per tile on every device and for both rasterisers. They must be equal to lists
// that are made with std::stable_sort. The cases are sizes near every block size, culled splats, equal
// depths, huge rectangles, wide images, images with many tiles, and totals beyond 32 bits. Every output
// buffer ends with guard words, which must not change. Also tests the prefix sums that the lists use.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "host/check/tile_lists.hpp"
#include "host/opencl/scan.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

using check::expected_lists;
using check::Words;
using Splats = check::ListedSplats;
using Expected = check::TileLists;
constexpr std::uint32_t kGuard = 0xabcdef01u;
constexpr std::size_t kGuards = 16;

class ListRandom : public Random {
 public:
  ListRandom() : Random(20) {}
  std::uint32_t bits() { return static_cast<std::uint32_t>(Random::bits()); }
  std::uint32_t below(std::uint32_t bound) { return bits() % bound; }
};
constexpr auto random_splats = check::made_up_splats;

Buffer<std::uint32_t> uploaded(Device& device, const Words& words) {
  Buffer<std::uint32_t> buffer(device, "test", words.size());
  buffer.upload(words);
  return buffer;
}

Buffer<std::uint32_t> guarded(Device& device, std::size_t size) {
  return uploaded(device, Words(size + kGuards, kGuard));
}

// Requires that the buffer contains the expected words and unchanged guard words. Does not use one assertion
// per word, because millions of assertions would be the slowest part of the test.
void require_equal(const char* what, const Buffer<std::uint32_t>& buffer, Words expected) {
  expected.resize(expected.size() + kGuards, kGuard);
  const Words found = buffer.download();
  const auto differs = std::mismatch(found.begin(), found.end(), expected.begin(), expected.end());
  INFO(what << " differs at " << differs.first - found.begin() << " of " << expected.size() - kGuards);
  REQUIRE(differs.first == found.end());
  REQUIRE(differs.second == expected.end());
}

void require_lists(Device& device, Stages& stages, const Splats& splats) {
  const Expected expected = expected_lists(splats);
  const auto counts = uploaded(device, splats.counts), keys = uploaded(device, splats.keys),
             rects = uploaded(device, splats.rects);
  const auto offsets = guarded(device, splats.count());
  const ListTotals totals = stages.count_lists({splats.count(), counts.view(), keys.view(), offsets.view()});
  REQUIRE(totals.visible == expected.totals.visible);
  REQUIRE(totals.intersections == expected.totals.intersections);
  require_equal("slot_offsets", offsets, expected.offsets);
  if (totals.intersections > UINT32_MAX) return;

  const auto ids = guarded(device, expected.ids.size()), slots = guarded(device, expected.ids.size()),
             ranges = guarded(device, expected.ranges.size());
  stages.build_lists({splats.count(), totals, splats.shape, keys.view(), rects.view(), offsets.view(),
                      ids.view(), slots.view(), ranges.view()});
  require_equal("tile_ranges", ranges, expected.ranges);
  require_equal("sorted_ids", ids, expected.ids);
  require_equal("sorted_slots", slots, expected.slots);
}

// Tests lists that are built without waiting for the totals, for a view that may have `drawn_room` visible
// splats, in buffers with a capacity of `room` intersections. The lists must equal expected_lists(), or be
// the lists of a view without splats if the view has more visible splats or intersections.
void require_bounded(Device& device, Stages& stages, const Splats& splats, std::uint64_t drawn_room,
                     std::uint64_t room) {
  const Expected counted = expected_lists(splats);
  const bool fits = counted.totals.visible <= drawn_room && counted.totals.intersections <= room;
  Splats none = splats;
  if (!fits) std::ranges::fill(none.counts, 0u);
  Expected expected = fits ? counted : expected_lists(none);
  const auto counts = guarded(device, splats.count()), keys = uploaded(device, splats.keys),
             rects = uploaded(device, splats.rects);
  device.write(*counts.view().memory, 0, std::as_bytes(std::span(splats.counts)));
  const auto offsets = guarded(device, splats.count());
  const auto ids = guarded(device, room), slots = guarded(device, room),
             ranges = guarded(device, expected.ranges.size());
  const Buffer<std::uint64_t> totals(device, "test", 2);
  INFO(counted.totals.visible << " visible splats, room for " << drawn_room);
  INFO(counted.totals.intersections << " intersections, room for " << room);
  const ListTotals bounds = stages.count_lists(
      {splats.count(), counts.view(), keys.view(), offsets.view(), totals.view(), {drawn_room, room}});
  const auto read = device.read_later(*totals.view().memory, 0, 2 * sizeof(std::uint64_t));
  CHECK(bounds.visible == drawn_room);
  CHECK(bounds.intersections == room);
  stages.build_lists({splats.count(), bounds, splats.shape, keys.view(), rects.view(), offsets.view(),
                      ids.view(), slots.view(), ranges.view(), true});
  std::array<std::uint64_t, 2> found{};
  std::memcpy(found.data(), read->wait().data(), sizeof found);
  REQUIRE(found == std::array{counted.totals.visible, counted.totals.intersections});
  require_equal("tile_counts", counts, fits ? splats.counts : none.counts);
  require_equal("tile_ranges", ranges, expected.ranges);
  // Between the end of a list and the capacity, sorting may have written any values. Beyond the capacity, no
  // values may be written.
  for (auto [what, buffer, list] :
       {std::tuple{"sorted_ids", &ids, &expected.ids}, {"sorted_slots", &slots, &expected.slots}}) {
    Words rest = buffer->download();
    rest.resize(room);
    std::ranges::copy(*list, rest.begin());
    require_equal(what, *buffer, rest);
  }
}

template <typename Body>
void on_all_stages(const Body& body, KernelConfig config = {}) {
  for (const auto& device : devices_under_test()) {
    for (RasterKind raster : rasters_of(*device)) {
      config.raster = raster;
      const auto stages = make_stages(*device, config);
      INFO(describe(device->info()) << (raster == RasterKind::cpu ? ", cpu kernels" : ", gpu kernels"));
      body(*device, *stages);
    }
  }
}

}  // namespace

TEST_CASE("Tile lists are correct without splats, with one splat, and with one tile", "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    require_lists(device, stages, random_splats(random, 0, 64, 48, 1, 1));
    require_lists(device, stages, random_splats(random, 1, 64, 48, 1, 1));
    require_lists(device, stages, random_splats(random, 1, 16, 16, 1, 0));
    require_lists(device, stages, random_splats(random, 5000, 200, 100, 0, 1));  // all splats are culled
    require_lists(device, stages, random_splats(random, 5000, 7, 9, 0.9f, 0));   // the image has one tile
  });
}

TEST_CASE("Tile lists are correct if the number of splats is near the size of a work-group, block or chunk",
          "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    for (std::uint32_t size : {16u, 256u, 2048u, 4096u, 8192u, 65536u}) {
      for (std::uint32_t count : {size - 1, size, size + 1}) {
        INFO(count << " splats");
        require_lists(device, stages, random_splats(random, count, 200, 200, 1, 1));
        require_lists(device, stages, random_splats(random, count, 333, 77, 0.5f, 5));
      }
    }
  });
}

TEST_CASE("Tile lists of views with upper bounds are correct, or empty if the view exceeds a bound",
          "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    const auto with_rooms = [&](const Splats& splats) {
      const std::uint64_t count = splats.count();
      const auto [visible, pairs] = expected_lists(splats).totals;
      for (const std::uint64_t room : {pairs, pairs + 1, pairs - 1, std::uint64_t{1}, 3 * pairs + 5000})
        if (room <= UINT32_MAX) require_bounded(device, stages, splats, count, room);
      for (const std::uint64_t drawn_room : {visible, visible - 1, std::uint64_t{1}, (visible + count) / 2})
        require_bounded(device, stages, splats, drawn_room, pairs);
      require_bounded(device, stages, splats, count, pairs);  // again, after views with other bounds
    };
    with_rooms(random_splats(random, 20000, 333, 77, 0.5f, 5));
    with_rooms(random_splats(random, 3000, 200, 200, 0.02f, 2));  // nearly all splats are culled
    with_rooms(random_splats(random, 2049, 16, 16, 1, 0));        // the image has one tile
    // With 16 tiles, their keys have four bits, so the largest possible key belongs to a tile.
    with_rooms(random_splats(random, 2048, 64, 64, 1, 1));
    require_bounded(device, stages, random_splats(random, 5000, 200, 100, 0, 1), 5000, 0);
    require_bounded(device, stages, random_splats(random, 5000, 200, 100, 0, 1), 700, 3000);
    require_bounded(device, stages, random_splats(random, 0, 64, 48, 1, 1), 0, 100);
    Splats beyond = random_splats(random, 1000, 160, 160, 1, 1);
    for (std::uint32_t& count : beyond.counts) count = 0xfffffff0u;  // the total needs more than 32 bits
    require_bounded(device, stages, beyond, 1000, 5000);
  });
}

TEST_CASE("Tile lists keep the order of indices among equal depths", "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    Splats splats = random_splats(random, 50000, 400, 400, 0.8f, 2);
    const auto with_depths = [&](const auto& key) {
      for (std::size_t i = 0; i < splats.keys.size(); ++i)
        if (splats.counts[i] > 0) splats.keys[i] = key();
      require_lists(device, stages, splats);
    };
    with_depths([] { return 0x40000000u; });
    with_depths([&] { return 0x40000000u + random.below(3); });
    with_depths([&] { return random.bits(); });  // keys that differ in every bit
  });
}

// Tests keys in a range of `bits` bits, including its smallest and its largest value. Sorting uses digits of
// several bits, so the numbers of bits are chosen near multiples of the number of bits of a digit. The ranges
// start at a round number, just below it, and at 0.
TEST_CASE("Tile lists are correct if depth keys only differ in a few bits", "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    Splats splats = random_splats(random, 9000, 100, 100, 0.7f, 1);
    for (const unsigned bits : {0u, 1u, 11u, 12u, 13u, 24u, 25u, 26u, 31u}) {
      for (const std::uint32_t least : {0x40000000u, 0x40000000u - 7, 0u}) {
        INFO(bits << " bits from " << least);
        const std::uint32_t last = (1u << bits) - 1;
        for (std::size_t i = 0; i < splats.keys.size(); ++i)
          if (splats.counts[i] > 0)
            splats.keys[i] = least + (i % 3 == 0 ? random.bits() & last : i % 3 == 1 ? 0 : last);
        require_lists(device, stages, splats);
      }
    }
  });
}

TEST_CASE("Tile lists are correct for more than a million splats", "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    require_lists(device, stages, random_splats(random, (1u << 20) + 1, 300, 300, 0.4f, 0));
  });
}

TEST_CASE("Tile lists are correct for splats on many tiles and for images with many tiles", "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    Splats square = random_splats(random, 300, 500 * 16, 500 * 16, 1, 1);
    square.set_rect(7, 0, 499, 0, 499);
    require_lists(device, stages, square);
    Splats single = random_splats(random, 1, 500 * 16, 500 * 16, 1, 1);
    single.set_rect(0, 0, 499, 0, 499);
    require_lists(device, stages, single);
    require_lists(device, stages, random_splats(random, 100000, 500 * 16, 500 * 16, 0.7f, 3));

    Splats wide = random_splats(random, 200, 70000, 1, 1, 900);
    wide.set_rect(0, 0, 4374, 0, 0);
    require_lists(device, stages, wide);
    // The numbers of tiles in a rectangle have 16 bits, so 65535 is the largest possible number.
    Splats widest = random_splats(random, 20, 65536 * 16, 1, 1, 30000);
    widest.set_rect(3, 0, 65535, 0, 0);
    require_lists(device, stages, widest);
    Splats tallest = random_splats(random, 20, 1, 65536 * 16, 1, 30000);
    tallest.set_rect(3, 0, 0, 0, 65535);
    require_lists(device, stages, tallest);
  });
}

// GPUs sort by tile with keys of 16 bits up to 65536 tiles, and with keys of 32 bits beyond. With 65536
// tiles, the largest possible key belongs to a tile.
TEST_CASE("Tile lists are correct for images with 65536 and with slightly more tiles", "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    for (const std::uint32_t across : {256u, 257u}) {
      const int side = static_cast<int>(across) * 16;
      Splats splats = random_splats(random, 300, side, side, 0.7f, 20);
      splats.set_rect(0, 0, 0, 0, 0);
      splats.set_rect(1, across - 1, across - 1, across - 1, across - 1);
      const ListTotals totals = expected_lists(splats).totals;
      require_lists(device, stages, splats);
      require_bounded(device, stages, splats, totals.visible, totals.intersections);
      require_bounded(device, stages, splats, totals.visible + 10, totals.intersections + 3000);
    }
  });
}

TEST_CASE("Totals of intersections beyond 32 bits are exact", "[lists]") {
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    Splats splats = random_splats(random, 65535, 160, 160, 1, 1);
    for (std::uint32_t& count : splats.counts) count = 0xfffffff0u - random.below(7);
    splats.counts[3] = 0;
    require_lists(device, stages, splats);
    Splats just_above = random_splats(random, 2, 160, 160, 1, 1);
    just_above.counts = {0xffffffffu, 1u};
    require_lists(device, stages, just_above);
  });
}

TEST_CASE("Tile lists do not depend on the lists that were built before", "[lists]") {
  // Values that a larger scene leaves in the scratch buffers must not affect the result.
  on_all_stages([](Device& device, Stages& stages) {
    ListRandom random;
    const Splats small = random_splats(random, 3000, 100, 100, 0.9f, 2);
    require_lists(device, stages, small);
    require_lists(device, stages, random_splats(random, 70000, 800, 600, 0.9f, 2));
    require_lists(device, stages, small);
  });
}

TEST_CASE("Each core gets the same number of chunks, and the chunks cover all elements", "[lists]") {
  for (std::uint64_t elements : {1ull, 4095ull, 8192ull, 30000ull, 57344ull, 1ull << 20, 5ull << 31})
    for (std::size_t cores : {1u, 2u, 3u, 8u, 64u})
      for (std::size_t most : {std::size_t{1}, cores, 4 * cores, 4 * cores + 1}) {
        INFO(elements << " elements, " << cores << " cores, at most " << most);
        const opencl::Blocks blocks = opencl::chunk_blocks(elements, most, cores);
        CHECK(blocks.count * blocks.size >= elements);
        CHECK((blocks.count - 1) * blocks.size < elements);
        // A chunk has at most 2^31 elements, so with very many elements there may be more than `most` chunks.
        // With few elements, a core may get no chunk.
        if (elements < (1ull << 31)) CHECK(blocks.count <= most);
        if (elements >= 4096 * cores * 16 && elements < (1ull << 31) && most >= cores)
          CHECK(blocks.count % cores == 0);
      }
  CHECK(opencl::chunk_blocks(30000, 8, 2).count == 8);
}

TEST_CASE("Prefix sums of 32-bit values are exact in 64 bits, and modulo 2^32 in 32 bits", "[lists][scan]") {
  for (const auto& shared : devices_under_test()) {
    auto* device = dynamic_cast<opencl::OpenclDevice*>(shared.get());
    if (!device) continue;
    for (RasterKind raster : {RasterKind::cpu, RasterKind::gpu}) {
      KernelConfig config;
      config.raster = raster;
      opencl::Scan scan(*device, config);
      ListRandom random;
      // The last size needs a third level of block sums on GPUs (more than 2048 x 2048 elements).
      for (std::uint32_t count : {0u, 1u, 255u, 256u, 257u, 2047u, 2048u, 2049u, 100000u, 4194305u}) {
        INFO(describe(device->info()) << ", " << count << " elements");
        Words values(count);
        for (std::uint32_t& value : values) value = random.bits();
        std::vector<std::uint64_t> sums(1, 0);
        for (std::uint32_t value : values) sums.push_back(sums.back() + value);
        const Words wrapped(sums.begin(), sums.end());

        const auto in = uploaded(*device, values), narrow = guarded(*device, count + std::size_t{1});
        const Buffer<std::uint64_t> wide(*device, "test", count + std::size_t{1});
        scan.exclusive(in.view(), narrow.view(), count);
        scan.exclusive(in.view(), wide.view(), count);
        require_equal("32-bit sums", narrow, wrapped);
        REQUIRE(wide.download() == sums);
      }
    }
  }
}

}  // namespace ubs
