// SPDX-License-Identifier: Apache-2.0
// Runs the fuzz targets in every build, without a fuzzer. The inputs are the seeds and damaged seeds. A seed
// is damaged at 60 to 119 evenly spaced positions, or at each byte if it has fewer than 60. At each position,
// five inputs are tested: the seed is truncated there, its byte is replaced by each of three values, or eight
// bytes are replaced by 0xff, which makes counts huge.
#include <catch2/catch.hpp>

#include "tests/fuzz/files.hpp"
#include "tests/fuzz/targets.hpp"

namespace {

void run(const ubs::fuzz::Target& target, const std::string& bytes) {
  target.run({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
}

}  // namespace

TEST_CASE("fuzz replay: seeds and damaged seeds are either read or give errors", "[fuzz]") {
  for (const ubs::fuzz::Target& target : ubs::fuzz::targets()) {
    INFO(target.name);
    std::size_t runs = 0;
    const std::vector<std::string> seeds = target.seeds();
    REQUIRE(!seeds.empty());
    const std::size_t before = ubs::fuzz::accepted;
    for (const std::string& seed : seeds) REQUIRE_NOTHROW(run(target, seed));
    CHECK(ubs::fuzz::accepted > before);
    for (const std::string& seed : seeds) {
      const std::size_t step = std::max<std::size_t>(1, seed.size() / 60);
      for (std::size_t at = 0; at < seed.size(); at += step) {
        REQUIRE_NOTHROW(run(target, seed.substr(0, at)));
        for (const char value : {'\0', '\x7f', '\xff'}) {
          std::string damaged = seed;
          damaged[at] = value;
          REQUIRE_NOTHROW(run(target, damaged));
          ++runs;
        }
        if (at + 8 <= seed.size())
          REQUIRE_NOTHROW(run(target, seed.substr(0, at) + std::string(8, '\xff') + seed.substr(at + 8)));
      }
    }
    CHECK(runs > 50);
  }
}
