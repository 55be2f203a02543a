// SPDX-License-Identifier: Apache-2.0
// The order of tiles by the length of their lists, and the turns that blocks take, on the host.
#include "cuda_backend/tile_order.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <numeric>
#include <random>
#include <set>

#include "cuda_backend/platform.hpp"

namespace ubs {
namespace {

#define UBS_TILE_TURNS
#include "cuda_backend/tile_turns.cuh"

// Which block drew a tile, and how often it was drawn.
__global__ void draw(unsigned tiles, const unsigned* order, unsigned* taken, unsigned* blocks,
                     unsigned* drawn) {
  UBS_EACH_TILE(tile, tiles, order, taken) {
    if (threadIdx.x != 0) continue;
    blocks[tile] = blockIdx.x;
    ++drawn[tile];
  }
}

struct Bench {
  std::unique_ptr<Device> opened = cuda::open_device(0);
  cuda::CudaDevice& device = dynamic_cast<cuda::CudaDevice&>(*opened);

  Buffer<std::uint32_t> buffer(const std::vector<std::uint32_t>& values) {
    Buffer<std::uint32_t> made(device, "values", values.size());
    made.upload(values);
    return made;
  }
  std::vector<std::uint32_t> order_of(const std::vector<std::uint32_t>& lengths) {
    std::vector<std::uint32_t> ranges{0};
    for (const std::uint32_t length : lengths) ranges.push_back(ranges.back() + length);
    cuda::TileOrder order(device);
    const auto tiles = static_cast<unsigned>(lengths.size());
    order.make(buffer(ranges).view(), tiles);
    CHECK(order.fits(tiles));
    CHECK_FALSE(order.fits(tiles + 1));
    std::vector<std::uint32_t> ids(lengths.size());
    device.read(*order.view().memory, 0, std::as_writable_bytes(std::span(ids)));
    return ids;
  }
};

TEST_CASE("tiles with long lists come first, each once", "[cuda]") {
  Bench b;
  CHECK(b.order_of({0, 3, 1, 1000, 2, 0, 4000}) == std::vector<std::uint32_t>{6, 3, 1, 4, 0, 2, 5});
  CHECK(b.order_of({7}) == std::vector<std::uint32_t>{0});
  CHECK(b.order_of({4'000'000'000u, 1u, 200'000'000u}) == std::vector<std::uint32_t>{0, 2, 1});
  std::mt19937 random(1);
  std::vector<std::uint32_t> lengths(2500);
  for (std::uint32_t& length : lengths) length = static_cast<std::uint32_t>(random() >> (8 + random() % 24));
  const auto order = b.order_of(lengths);
  CHECK(std::set<std::uint32_t>(order.begin(), order.end()).size() == lengths.size());
  for (std::size_t i = 1; i < order.size(); ++i) {
    const double before = lengths[order[i - 1]], now = lengths[order[i]];
    REQUIRE(now <= 1.125 * std::max(before, 1.0));  // the width of a step
    if (before == now) REQUIRE(order[i - 1] < order[i]);
  }
}

TEST_CASE("every tile is drawn once, by any number of blocks, and none is taken for the next launch",
          "[cuda]") {
  Bench b;
  for (const unsigned tiles : {1u, 2u, 3u, 7u, 64u}) {
    std::vector<std::uint32_t> reversed(tiles);
    std::iota(reversed.rbegin(), reversed.rend(), 0u);
    const auto order = b.buffer(reversed);
    auto taken = b.buffer({0});
    for (const unsigned blocks : {1u, 2u, 3u, 64u})
      for (const bool ordered : {false, true}) {
        if (blocks > tiles) continue;
        INFO(tiles << " tiles, " << blocks << " blocks");
        auto owners = b.buffer(std::vector<std::uint32_t>(tiles, 99)),
             drawn = b.buffer(std::vector<std::uint32_t>(tiles, 0));
        b.device.launch("draw",
                        cuda::Kernel<void(unsigned, const unsigned*, unsigned*, unsigned*, unsigned*)>(draw),
                        blocks, 64, tiles, ordered ? order.view() : View1<std::uint32_t>{}, taken.view(),
                        owners.view(), drawn.view());
        CHECK(drawn.download() == std::vector<std::uint32_t>(tiles, 1));
        CHECK(taken.download()[0] == 0);
        // Each block has its own turn for sure.
        const auto owner = owners.download();
        for (unsigned block = 0; block < blocks; ++block) {
          const unsigned first = ordered ? reversed[block] : block;
          CHECK(owner[first] == block);
        }
      }
  }
}

}  // namespace
}  // namespace ubs
