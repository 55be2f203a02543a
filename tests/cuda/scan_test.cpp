// SPDX-License-Identifier: Apache-2.0
// Tests AddCounts, which adds numbers of splats and tiles that are packed into one word. The sum must not
// depend on how the splats are divided into ranges, and the number of tiles must saturate at the largest
// value that fits.
#include <catch2/catch.hpp>
#include <random>

#include "cuda_backend/device_algorithms.hpp"

namespace ubs::cuda {
namespace {

TEST_CASE("the sum of packed counts does not depend on how the splats are divided into ranges", "[cuda]") {
  std::mt19937 random{3};
  for (const u32 bits : {2u, 17u, 24u, 31u}) {
    const PackCounts counts{bits};
    const AddCounts add{bits};
    const u64 most = ~u64{0} >> bits;
    for (int round = 0; round < 2000; ++round) {
      const int splats = bits == 2 ? 3 : 8;
      std::vector<u64> words;
      u64 drawn = 0, tiles = 0;
      for (int i = 0; i < splats; ++i) {
        const u32 mine = random() % 3 == 0 ? 0 : static_cast<u32>(random()) >> random() % 32;
        words.push_back(counts(mine));
        // Adds more tiles, up to the largest number that fits. A single splat has less than 2^32 tiles;
        // larger numbers occur only in the sums of ranges.
        const u64 more = mine > 0 && bits > 2 ? (u64{random()} << (random() % 40)) % (most - mine) : 0;
        words.back() += more << bits;
        drawn += mine > 0 ? 1 : 0;
        tiles = std::min(most, tiles + std::min(most, mine + more));
      }
      const std::size_t cut = 1 + random() % (words.size() - 1);
      const auto sum = [&](std::size_t from, std::size_t to) {
        u64 total = words[from];
        for (std::size_t i = from + 1; i < to; ++i) total = add(total, words[i]);
        return total;
      };
      const u64 whole = sum(0, words.size());
      REQUIRE(whole == add(sum(0, cut), sum(cut, words.size())));
      REQUIRE((whole & ((u64{1} << bits) - 1)) == drawn);
      REQUIRE(whole >> bits == tiles);
    }
  }
}

}  // namespace
}  // namespace ubs::cuda
