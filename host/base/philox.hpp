// SPDX-License-Identifier: Apache-2.0
// CounterRandom generates random numbers with the counter-based generator Philox4x32-10 of Salmon, Moraes,
// Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3" (SC 2011). Ten rounds of multiplications and
// swaps turn a 128-bit counter and a 64-bit key into 128 random bits. The generator has no state: number j of
// item i depends only on the seed, the stream, i and j. So the numbers do not depend on the number of
// threads, the order of calls or the standard library.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace ubs {

using PhiloxCounter = std::array<std::uint32_t, 4>;
using PhiloxKey = std::array<std::uint32_t, 2>;

inline PhiloxCounter philox4x32_10(PhiloxCounter c, PhiloxKey k) {
  constexpr std::uint64_t kMultiplier0 = 0xD2511F53u, kMultiplier1 = 0xCD9E8D57u;
  constexpr std::uint32_t kWeyl0 = 0x9E3779B9u, kWeyl1 = 0xBB67AE85u;  // golden ratio and sqrt(3) - 1
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t p0 = kMultiplier0 * c[0], p1 = kMultiplier1 * c[2];
    c = {static_cast<std::uint32_t>(p1 >> 32) ^ c[1] ^ k[0], static_cast<std::uint32_t>(p1),
         static_cast<std::uint32_t>(p0 >> 32) ^ c[3] ^ k[1], static_cast<std::uint32_t>(p0)};
    k = {k[0] + kWeyl0, k[1] + kWeyl1};
  }
  return c;
}

// CounterRandom returns independent random numbers for each `item` and `lane`, in any order. Parts of the
// program that share a seed use different values of `stream`. A uniform and a normal number of the same item
// and lane are independent, because they come from different counters.
class CounterRandom {
 public:
  CounterRandom(std::uint64_t seed, std::uint32_t stream)
      : key_{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)}, stream_(stream) {}

  std::uint32_t bits(std::uint64_t item, std::uint32_t lane) const { return block(item, lane / 4)[lane % 4]; }

  // Returns a number in the open interval (0, 1). It is never 0, so log() in normal() is finite.
  double uniform(std::uint64_t item, std::uint32_t lane) const { return to_unit(bits(item, lane)); }

  double uniform(std::uint64_t item, std::uint32_t lane, double low, double high) const {
    return low + (high - low) * uniform(item, lane);
  }

  // Returns a number with the standard normal distribution. The method of Box and Muller makes two of them
  // from two uniform numbers, so one call of block() gives four of them.
  double normal(std::uint64_t item, std::uint32_t lane) const {
    const PhiloxCounter words = block(item, kNormalBlocks | (lane / 4));
    const std::uint32_t pair = (lane % 4) / 2 * 2;
    const double radius = std::sqrt(-2.0 * std::log(to_unit(words[pair])));
    const double angle = 2.0 * std::numbers::pi * to_unit(words[pair + 1]);
    return radius * (lane % 2 == 0 ? std::cos(angle) : std::sin(angle));
  }

 private:
  static constexpr std::uint32_t kNormalBlocks = 0x80000000u;

  static double to_unit(std::uint32_t word) { return (static_cast<double>(word) + 0.5) * 0x1p-32; }

  PhiloxCounter block(std::uint64_t item, std::uint32_t number) const {
    return philox4x32_10(
        {static_cast<std::uint32_t>(item), static_cast<std::uint32_t>(item >> 32), stream_, number}, key_);
  }

  PhiloxKey key_;
  std::uint32_t stream_;
};

}  // namespace ubs
