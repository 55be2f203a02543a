// SPDX-License-Identifier: Apache-2.0
// Compares the random number generator Philox of the kernels with the published results of its authors (the
// library Random123) and with the implementation of the host. Also tests the moments of the normal numbers.
// clang-format off
#include <catch2/catch.hpp>

#include <cmath>

#include "host/base/philox.hpp"

// Each of these headers needs the headers before it.
#include "kernels/dialect/dialect.h"
#include "kernels/layout.h"
#include "kernels/math/elementary.h"
#include "kernels/math/rng.h"
// clang-format on

namespace {

void check_words(RandomWords counter, unsigned key0, unsigned key1, RandomWords expected) {
  const RandomWords got = philox4x32_10(counter, key0, key1);
  CHECK(got.x == expected.x);
  CHECK(got.y == expected.y);
  CHECK(got.z == expected.z);
  CHECK(got.w == expected.w);
}

}  // namespace

TEST_CASE("Philox gives the published results", "[rng]") {
  check_words({0, 0, 0, 0}, 0, 0, {0x6627e8d5u, 0xe169c58du, 0xbc57ac4cu, 0x9b00dbd8u});
  const unsigned ones = 0xffffffffu;
  check_words({ones, ones, ones, ones}, ones, ones, {0x408f276du, 0x41c83b0eu, 0xa20bc7c6u, 0x6d5451fdu});
  check_words({0x243f6a88u, 0x85a308d3u, 0x13198a2eu, 0x03707344u}, 0xa4093822u, 0x299f31d0u,
              {0xd16cfe09u, 0x94fdccebu, 0x5001e420u, 0x24126ea1u});
}

TEST_CASE("Philox gives the same numbers in the kernels and on the host", "[rng]") {
  for (unsigned i = 0; i < 1000; ++i) {
    const unsigned a = i * 2654435761u, b = i * 40503u + 17u;
    const RandomWords kernel = philox4x32_10({a, b, a ^ b, i}, b + 1, a + 3);
    const ubs::PhiloxCounter host = ubs::philox4x32_10({a, b, a ^ b, i}, {b + 1, a + 3});
    REQUIRE(kernel.x == host[0]);
    REQUIRE(kernel.y == host[1]);
    REQUIRE(kernel.z == host[2]);
    REQUIRE(kernel.w == host[3]);
  }
}

TEST_CASE("random numbers depend on the seed, the iteration, the purpose and the index", "[rng]") {
  const RandomWords base = random_words(1, 2, 3, 4, 5, 6);
  for (const RandomWords other :
       {random_words(9, 2, 3, 4, 5, 6), random_words(1, 9, 3, 4, 5, 6), random_words(1, 2, 9, 4, 5, 6),
        random_words(1, 2, 3, 9, 5, 6), random_words(1, 2, 3, 4, 9, 6), random_words(1, 2, 3, 4, 5, 9)})
    CHECK((base.x != other.x || base.y != other.y));
}

TEST_CASE("the smallest and the largest random words give finite uniform and normal numbers", "[rng]") {
  CHECK(random_uniform(0u) == 0x1p-33);
  CHECK(random_uniform(0xffffffffu) < 1.0);
  const RandomNormals low = random_normals({0, 0, 0, 0});
  CHECK(low.x == Approx(std::sqrt(66 * std::log(2.0))));
  CHECK(low.x < 6.77);
  const RandomNormals high = random_normals({0xffffffffu, 0xffffffffu, 0xffffffffu, 0xffffffffu});
  CHECK(std::isfinite(high.x));
  CHECK(std::isfinite(high.w));
}

TEST_CASE("normal random numbers have the moments of the normal distribution", "[rng]") {
  constexpr unsigned kBlocks = 50000;
  double sum = 0, square = 0, fourth = 0, cross = 0;
  for (unsigned i = 0; i < kBlocks; ++i) {
    const RandomNormals n = random_normals(random_words(42, 0, 7, 0, kDrawNoise, i));
    for (const double x : {n.x, n.y, n.z, n.w}) sum += x, square += x * x, fourth += x * x * x * x;
    cross += n.x * n.y + n.z * n.w + n.x * n.z;
  }
  // The bounds are five standard deviations of each estimate. For n numbers, the standard deviations are
  // sqrt(1/n) for the mean, sqrt(2/n) for the square, sqrt(96/n) for the fourth power, and sqrt(1/n) for the
  // product of two numbers.
  constexpr double kCount = 4.0 * kBlocks;
  CHECK(std::abs(sum / kCount) < 5 * std::sqrt(1 / kCount));
  CHECK(std::abs(square / kCount - 1) < 5 * std::sqrt(2 / kCount));
  CHECK(std::abs(fourth / kCount - 3) < 5 * std::sqrt(96 / kCount));
  CHECK(std::abs(cross / (3.0 * kBlocks)) < 5 * std::sqrt(1 / (3.0 * kBlocks)));
}
