// SPDX-License-Identifier: Apache-2.0
// Random generates random numbers for synthetic scenes and for inputs of checks. ubs has its own generator,
// because the results of the distributions in <random> depend on the standard library. Kernels and training
// use the counter-based generator of philox.hpp instead.
#pragma once

#include <cstdint>

namespace ubs {

// Random uses the generator splitmix64. A seed gives the same numbers on all machines. For this reason, the
// project is compiled with -ffp-contract=off, so that compilers do not merge multiplications and additions.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  std::uint64_t bits() {
    std::uint64_t z = state_ += 0x9e3779b97f4a7c15ULL;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  }
  // Returns a number in [low, high).
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(bits() >> 11) * 0x1p-53);
  }
  // Returns the sum of 12 uniform numbers minus 6. This approximates a normal distribution with mean 0 and
  // standard deviation 1; the magnitude is at most 6.
  double normal() {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += uniform(0, 1);
    return sum;
  }

 private:
  std::uint64_t state_;
};

}  // namespace ubs
