// SPDX-License-Identifier: Apache-2.0
// Compares the random number generator Philox with published results, and tests every parameter of the
// initial model (docs/method.md, section 1.3).
#include "host/scene/initialise.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/base/philox.hpp"
#include "host/scene/doubles.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

struct Moments {
  double low = std::numeric_limits<double>::infinity(), high = -low, mean = 0, deviation = 0;
};

Moments moments(std::span<const float> row) {
  Moments m;
  for (const float v : row) {
    m.low = std::min<double>(m.low, v);
    m.high = std::max<double>(m.high, v);
    m.mean += v / static_cast<double>(row.size());
  }
  for (const float v : row) m.deviation += (v - m.mean) * (v - m.mean) / static_cast<double>(row.size());
  m.deviation = std::sqrt(m.deviation);
  return m;
}

bool all_equal(std::span<const float> row, float value) {
  return std::all_of(row.begin(), row.end(), [&](float v) { return v == value; });
}

double softplus(double x) { return std::log1p(std::exp(x)); }

}  // namespace

TEST_CASE("philox: results agree with the known answers that Random123 contains", "[initialise]") {
  CHECK(philox4x32_10({0, 0, 0, 0}, {0, 0}) == PhiloxCounter{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8});
  const std::uint32_t f = 0xffffffff;
  CHECK(philox4x32_10({f, f, f, f}, {f, f}) == PhiloxCounter{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd});
  CHECK(philox4x32_10({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}) ==
        PhiloxCounter{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1});
}

TEST_CASE("philox: uniform and normal random numbers have the expected moments", "[initialise]") {
  const CounterRandom random(42, 3), other(42, 4);
  constexpr std::uint64_t n = 100000;
  double u1 = 0, u2 = 0, g1 = 0, g2 = 0, g4 = 0, pair = 0, streams = 0;
  for (std::uint64_t i = 0; i < n; ++i) {
    const double u = random.uniform(i, 0), a = random.normal(i, 0), b = random.normal(i, 1);
    u1 += u / n;
    u2 += u * u / n;
    g1 += a / n;
    g2 += a * a / n;
    g4 += a * a * a * a / n;
    pair += a * b / n;
    streams += (u - 0.5) * (other.uniform(i, 0) - 0.5) / n;
  }
  // Each margin is five standard errors of the mean of n = 1e5 random numbers.
  CHECK(u1 == Approx(0.5).margin(5 * 0.2887 / 316));
  CHECK(u2 == Approx(1.0 / 3).margin(5 * 0.298 / 316));
  CHECK(g1 == Approx(0).margin(5.0 / 316));
  CHECK(g2 == Approx(1).margin(5 * 1.414 / 316));
  CHECK(g4 == Approx(3).margin(5 * 9.8 / 316));
  CHECK(pair == Approx(0).margin(5.0 / 316));
  CHECK(streams == Approx(0).margin(5 * 0.0833 / 316));
}

TEST_CASE("initialise: neighbour distances agree with brute force", "[initialise]") {
  const CounterRandom random(7, 0);
  std::vector<std::array<float, 3>> points(300);
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::uint32_t k = 0; k < 3; ++k) points[i][k] = static_cast<float>(random.uniform(i, k));
  points[17] = points[18] = points[19] = points[20] = points[21] = points[22];  // six points at one position
  const auto fast = neighbour_distances(points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    std::vector<double> squared;
    for (std::size_t j = 0; j < points.size(); ++j) {
      if (i == j) continue;
      double d = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const double difference = static_cast<double>(points[i][k]) - static_cast<double>(points[j][k]);
        d += difference * difference;
      }
      squared.push_back(d);
    }
    std::sort(squared.begin(), squared.end());
    const double expected = std::max(1e-7, std::sqrt((squared[0] + squared[1] + squared[2]) / 3));
    CHECK(fast[i] == Approx(expected).epsilon(1e-12));
  }
  CHECK(fast[18] == 1e-7);
  const std::vector<std::array<float, 3>> two{{0, 0, 0}, {0, 3, 4}};
  CHECK(neighbour_distances(two) == std::vector<double>{5, 5});
  CHECK(neighbour_distances(std::span(two).first(1)) == std::vector<double>{0.1});
  const std::vector<std::array<float, 3>> same(5000, {1, 1, 1});
  CHECK(neighbour_distances(same) == std::vector<double>(5000, 1e-7));
}

TEST_CASE("initialise: every parameter of the random model has the documented distribution", "[initialise]") {
  const int dim = GENERATE(3, 4, 5, 6, 7, 9, 11);
  constexpr std::size_t n = 20000;
  const SplatModel model = initialise_random(dim, n, 1);
  const ParameterLayout l = model.layout();
  CAPTURE(dim);
  REQUIRE(model.count == n);
  CHECK(std::all_of(model.values.begin(), model.values.end(), [](float v) { return std::isfinite(v); }));
  for (int axis = 0; axis < 3; ++axis) {
    const Moments m = moments(model.row(l.xyz + axis));
    CHECK(m.low >= -1.3);
    CHECK(m.high <= 1.3f);
    CHECK(m.low < -1.29);
    CHECK(m.high > 1.29);
    CHECK(all_equal(model.row(l.rgb + axis), 127.0f / 255.0f));
    CHECK(std::ranges::equal(model.row(l.scale + axis), model.row(l.scale)));
  }
  // The scale is the root mean square distance to the three nearest neighbours. For n uniform points, it is
  // about 0.65 n^(-1/3) times the side of the box, which is 2.6.
  CHECK(softplus(moments(model.row(l.scale)).mean) == Approx(0.65 * 2.6 / std::cbrt(n)).epsilon(0.2));
  CHECK(all_equal(model.row(l.opacity), 0.0f));
  CHECK(all_equal(model.row(l.beta), 0.0f));
  for (int q = 0; q < l.query; ++q) {
    const bool direction = dim >= 6 && q < 3;
    CHECK(all_equal(model.row(l.beta + 1 + q), dim == 7 && direction ? -3.0f : 0.0f));
    const Moments mean = moments(model.row(l.mean + q));
    CHECK(mean.low < (direction ? -0.99 : 0.01));
    CHECK(mean.low >= (direction ? -1 : 0));
    CHECK(mean.high > 0.99);
    CHECK(mean.high <= 1);
    const Moments scale = moments(model.row(l.scale + 3 + q));
    CHECK(softplus(scale.mean) == Approx(1).margin(1e-6));
    // The derivative of softplus at the raw value 0.5413 is sigmoid(0.5413) = 0.632, so the deviation of the
    // raw values is 1e-5 / 0.632. The spacing of float values there is 6e-8.
    CHECK(scale.deviation == Approx(1e-5 / 0.632).epsilon(0.03));
  }
  for (int r = l.l_triangle; r < l.count; ++r) {
    const Moments m = moments(model.row(r));
    CHECK(m.mean == Approx(0).margin(5e-5 / std::sqrt(n)));
    CHECK(m.deviation == Approx(1e-5).epsilon(0.03));
  }
}

TEST_CASE("initialise: the model is reproducible, and depends on seed and options", "[initialise]") {
  const SplatModel a = initialise_random(6, 500, 1), b = initialise_random(6, 500, 1),
                   c = initialise_random(6, 500, 2);
  CHECK(a.values == b.values);
  CHECK(a.row(0)[0] != c.row(0)[0]);
  // Random numbers are computed from their index, so the first points do not depend on the number of points.
  CHECK(initialise_random(6, 100, 1).row(0)[99] == a.row(0)[99]);
  InitOptions options;
  options.box = 0.5;
  options.opacity = 0.1;
  options.beta_dir = -1.5;
  const SplatModel d = initialise_random(6, 500, 1, options);
  CHECK(moments(d.row(1)).high <= 0.5);
  CHECK(d.row(d.layout().opacity)[0] == Approx(std::log(0.1 / 0.9)));
  CHECK(all_equal(d.row(d.layout().beta + 3), -1.5f));
  CHECK(all_equal(d.row(d.layout().beta), 0.0f));
}

TEST_CASE("initialise: points determine positions, colours and scales", "[initialise]") {
  const std::vector<std::array<float, 3>> positions{{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 3}};
  const std::vector<std::array<std::uint8_t, 3>> colours{{0, 51, 255}, {1, 2, 3}, {4, 5, 6}, {7, 8, 9}};
  const SplatModel model = initialise_from_points(7, positions, colours, 0);
  CHECK(model.row(1)[2] == 2.0f);
  CHECK(model.row(3)[0] == 0.0f);
  CHECK(model.row(4)[0] == 0.2f);
  CHECK(model.row(5)[0] == 1.0f);
  CHECK(softplus(model.row(model.layout().scale)[0]) == Approx(std::sqrt((1 + 4 + 9) / 3.0)));
}

TEST_CASE("initialise: invalid points and options are rejected", "[initialise]") {
  const std::vector<std::array<float, 3>> bad{{0, std::numeric_limits<float>::quiet_NaN(), 0}};
  const std::vector<std::array<std::uint8_t, 3>> grey{{127, 127, 127}};
  CHECK_THAT(message_of([&] { initialise_from_points(6, bad, grey, 0); }),
             Contains("initial point 0 is not finite"));
  CHECK_THAT(message_of([] { initialise_random(6, 0, 0); }), Contains("at least one point"));
  CHECK_THAT(message_of([&] { initialise_from_points(6, bad, {}, 0); }, ErrorKind::internal),
             Contains("as many colours, but there are 0"));
  InitOptions options;
  options.opacity = 1;
  CHECK_THAT(message_of([&] { initialise_random(6, 5, 0, options); }, ErrorKind::usage),
             Contains("initial opacity"));
  options = {};
  options.box = 0;
  CHECK_THAT(message_of([&] { initialise_random(6, 5, 0, options); }, ErrorKind::usage),
             Contains("initial box"));
}

TEST_CASE("initial Gaussians are as wide as initial Beta splats", "[init]") {
  InitOptions gaussian;
  gaussian.variant.kernel = SpatialKernel::gaussian;
  const SplatModel a = initialise_random(3, 50, 1), b = initialise_random(3, 50, 1, gaussian);
  for (std::size_t i = 0; i < 50; ++i)
    CHECK(softplus(a.row(a.layout().scale)[i]) ==
          Approx(3.08 * softplus(b.row(b.layout().scale)[i])).epsilon(1e-5));
}

TEST_CASE("splats that are practically equal to another live one are counted as doubles", "[doubles]") {
  for (const int dim : {3, 7})
    for (const Conditioning conditioning : {Conditioning::covariance, Conditioning::direct}) {
      ModelVariant variant;
      variant.conditioning = conditioning;
      SplatModel model(dim, 100, variant);
      const ParameterLayout l = model.layout();
      for (std::size_t i = 0; i < model.count; ++i) model.row(l.xyz)[i] = 100.0f * static_cast<float>(i);
      CHECK(share_of_doubles(model) == 0);
      // Splat 1 becomes a copy of splat 0. All scales are softplus(0) = 0.69.
      model.row(l.xyz)[1] = 0.01f;
      CHECK(share_of_doubles(model) == Approx(0.02));
      const auto differs = [&](int row, float by) {
        SplatModel other = model;
        other.row(row)[1] += by;
        return share_of_doubles(other) == 0;
      };
      CHECK(differs(l.xyz + 1, 0.03f));
      CHECK_FALSE(differs(l.xyz + 1, 0.01f));
      CHECK(differs(l.scale + 2, 0.3f));
      CHECK_FALSE(differs(l.scale + 2, 0.05f));
      CHECK(differs(l.rgb + 1, 0.06f));
      CHECK_FALSE(differs(l.rgb + 1, 0.04f));
      CHECK(differs(l.beta, -0.3f));
      CHECK(differs(l.opacity, -20));  // a dead splat is not a double
      if (dim == 7) {
        CHECK(differs(l.mean + 3, 0.2f));
        CHECK_FALSE(differs(l.mean + 3, 0.05f));
      }
      // A group of four copies
      for (std::size_t i = 2; i < 4; ++i)
        for (int r = 0; r < l.count; ++r) model.row(r)[i] = model.row(r)[0];
      CHECK(share_of_doubles(model) == Approx(0.04));
      model.row(l.xyz)[1] = std::numeric_limits<float>::quiet_NaN();
      CHECK(share_of_doubles(model) == Approx(3.0 / 99));
    }
  CHECK(share_of_doubles(SplatModel(3, 0)) == 0);
}
