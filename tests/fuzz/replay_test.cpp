// SPDX-License-Identifier: Apache-2.0
// Runs the fuzz targets without a fuzzer in every build: with the seeds, and with systematic damage to them
// (truncated at up to 60 positions, bytes replaced by three values, and counts made huge).
#include <catch2/catch.hpp>

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
    for (const std::string& seed : seeds) {
      REQUIRE_NOTHROW(run(target, seed));
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
