// SPDX-License-Identifier: Apache-2.0
// Tests the stages Relocate, Grow and AddNoise on every device: which splats are moved to which source
// splats, the opacities, moments, sizes and places of the copies, reproducibility, the distribution of
// sources, models in which all or no splats are dead, and the noise.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <vector>

#include "host/base/error.hpp"
#include "host/check/copied_splats.hpp"
#include "host/lab/oracle/learning.hpp"
#include "tests/support/stages_fixture.hpp"

namespace {

using namespace ubs;
using test::for_each_stages;

constexpr int kDim = 6;
constexpr std::size_t kRows = 35, kOpacityRow = 6, kScaleRow = 14, kSkewRow = 20;  // kernels/layout.h
constexpr float kDead = -8.0f;  // a raw opacity below the threshold for relocation
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

double logistic(double x) { return 1 / (1 + std::exp(-x)); }
double opacity_of(float raw) { return logistic(raw); }

struct Model : check::Population {
  Model(std::uint32_t count_, std::uint32_t capacity, float raw_opacity)
      : Population(ParameterLayout(kDim), count_, capacity, raw_opacity) {}
};

class OnDevice {
 public:
  OnDevice(Device& device, const Model& model)
      : params_(device, "params", model.params.size()),
        m1_(device, "m1", model.params.size()),
        m2_(device, "m2", model.params.size()),
        count_(model.count),
        stride_(model.stride) {
    params_.upload(model.params);
    m1_.upload(model.moment1);
    m2_.upload(model.moment2);
  }
  SplatView splats() const { return {params_.view(), count_, stride_}; }
  std::uint32_t relocate(Stages& stages, std::uint64_t seed = 1, std::uint64_t iteration = 600,
                         float spread = 0) {
    return stages.relocate({splats(), m1_.view(), m2_.view(), seed, iteration, spread});
  }
  void grow(Stages& stages, std::uint32_t target, std::uint64_t seed = 1, float spread = 0) {
    stages.grow({splats(), target, m1_.view(), m2_.view(), seed, 600, spread});
  }
  Model download(Model model) const {
    params_.download(std::span<float>(model.params));
    m1_.download(std::span<float>(model.moment1));
    m2_.download(std::span<float>(model.moment2));
    return model;
  }

 private:
  Buffer<float> params_, m1_, m2_;
  std::uint32_t count_, stride_;
};

std::map<std::uint32_t, int> check_copies(const Model& before, const Model& after,
                                          const std::vector<std::uint32_t>& written) {
  const check::Copies copies = check::judge_copies(before, after, written);
  REQUIRE(copies.problem == "");
  REQUIRE(copies.opacity_error < 4.8e-7);  // the largest error observed is 2.4e-7
  return copies.of_source;
}

}  // namespace

TEST_CASE("relocation moves dead splats to living ones and splits the opacity", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    Model model(500, 500, 0.0f);
    std::mt19937 random(4);
    std::normal_distribution<float> normal(0, 2);
    std::vector<std::uint32_t> dead;
    for (std::uint32_t i = 0; i < model.count; ++i) {
      model.at(kOpacityRow, i) = std::max(normal(random), -5.0f);
      if (i % 3 == 1) model.at(kOpacityRow, i) = i % 2 ? kDead : kNan, dead.push_back(i);
    }
    OnDevice on(device, model);
    CHECK(on.relocate(stages) == dead.size());
    const auto copies = check_copies(model, on.download(model), dead);
    CHECK(copies.size() > 50);
    for (const auto& [source, n] : copies) CHECK(source % 3 != 1);
    // Relocation reduces the opacities of the sources and of their copies, so a few of these splats may be
    // dead afterwards.
    CHECK(on.relocate(stages) < dead.size() / 10);
  });
}

TEST_CASE("relocation without dead or without living splats does not change the model", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    for (const float raw : {1.0f, kDead, -std::numeric_limits<float>::infinity()}) {
      const Model model(100, 100, raw);
      OnDevice on(device, model);
      CHECK(on.relocate(stages) == 0);
      const Model after = on.download(model);
      CHECK(after.params == model.params);
      CHECK(after.moment1 == model.moment1);
    }
    const Model none(0, 64, 0.0f);
    OnDevice on(device, none);
    CHECK(on.relocate(stages) == 0);
  });
}

TEST_CASE("all dead splats are moved to the only living one, even if its opacity is 1", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    for (const float raw : {2.0f, 30.0f, 1e30f, std::numeric_limits<float>::infinity()}) {
      Model model(5000, 5000, kDead);
      model.at(kOpacityRow, 1234) = raw;
      OnDevice on(device, model);
      CHECK(on.relocate(stages) == 4999);
      const Model after = on.download(model);
      const double expected = check::split_opacity(logistic(raw), 5000);
      for (std::uint32_t i = 0; i < model.count; ++i) {
        REQUIRE(after.origin(i) == 1234);
        REQUIRE(after.at(kOpacityRow, i) == after.at(kOpacityRow, 1234));
      }
      // For large raw values, the opacity o rounds to 1 in float, so the expected value cannot be computed
      // from 1 - o.
      if (raw < 20) CHECK(opacity_of(after.at(kOpacityRow, 0)) == Approx(expected).epsilon(2e-6));
      if (raw > 1e6)
        CHECK(opacity_of(after.at(kOpacityRow, 0)) == Approx(1 - std::ldexp(1.0, -23)).epsilon(1e-12));
      CHECK(std::isfinite(after.at(kOpacityRow, 0)));
    }
  });
}

TEST_CASE("growth writes the new splats and nothing after them", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    Model model(1000, 1100, 0.5f);
    for (std::uint32_t i = 0; i < 100; ++i) model.at(kOpacityRow, i) = kNan;
    for (const std::uint32_t target : {1020u, 1100u, 1088u}) {
      OnDevice on(device, model);
      on.grow(stages, target);
      const Model after = on.download(model);
      std::vector<std::uint32_t> slots;
      for (std::uint32_t i = model.count; i < target; ++i) slots.push_back(i);
      Model before = model;
      for (std::uint32_t i = 0; i < 100; ++i) {
        REQUIRE(std::isnan(after.at(kOpacityRow, i)));
        before.at(kOpacityRow, i) = 0;
      }
      Model compared = after;
      for (std::uint32_t i = 0; i < 100; ++i) compared.at(kOpacityRow, i) = 0;
      for (const auto& [source, n] : check_copies(before, compared, slots)) CHECK(source >= 100);
      for (std::uint32_t i = target; i < model.stride; ++i) {
        REQUIRE(after.at(0, i) == 0);
        REQUIRE(after.moment1[i] == 1.5f);
      }
    }
  });
}

TEST_CASE("growth respects the capacity, rejects empty models and accepts invalid splats", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    const Model model(60, 64, 0.0f);
    OnDevice on(device, model);
    on.grow(stages, 60);
    on.grow(stages, 10);
    CHECK(on.download(model).params == model.params);
    CHECK_THROWS_AS(on.grow(stages, 65), Error);
    OnDevice none(device, Model(0, 64, 0.0f));
    CHECK_THROWS_AS(none.grow(stages, 10), Error);
    // All sampling weights are 0, so sources are chosen uniformly, and the opacity becomes the minimum.
    const Model invalid(60, 64, kNan);
    OnDevice poisoned(device, invalid);
    poisoned.grow(stages, 64);
    const Model after = poisoned.download(invalid);
    for (std::uint32_t i = 60; i < 64; ++i) {
      CHECK(after.origin(i) < 60);
      CHECK(opacity_of(after.at(kOpacityRow, i)) == Approx(0.005).epsilon(1e-6));
    }
  });
}

TEST_CASE("sources are sampled with probabilities proportional to their opacities", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    constexpr std::uint32_t kSources = 50, kDraws = 100000;
    Model model(kSources + kDraws, kSources + kDraws, kDead);
    double total = 0;
    for (std::uint32_t i = 0; i < kSources; ++i) {
      model.at(kOpacityRow, i) = -4.0f + 0.16f * static_cast<float>(i);
      total += opacity_of(model.at(kOpacityRow, i));
    }
    OnDevice on(device, model);
    CHECK(on.relocate(stages, 77) == kDraws);
    const Model after = on.download(model);
    std::vector<double> drawn(kSources, 0);
    for (std::uint32_t i = kSources; i < model.count; ++i) ++drawn.at(after.origin(i));
    double chi_square = 0;
    for (std::uint32_t i = 0; i < kSources; ++i) {
      const double expected = kDraws * opacity_of(model.at(kOpacityRow, i)) / total;
      chi_square += (drawn[i] - expected) * (drawn[i] - expected) / expected;
    }
    // With 49 degrees of freedom, values above 94 and values below 17 each have a probability of about 1e-4
    // or less.
    CHECK(chi_square < 94);
    CHECK(chi_square > 17);
  });
}

TEST_CASE("relocation and growth are reproducible bit for bit, and depend on the seed", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    Model model(3000, 3100, 0.3f);
    for (std::uint32_t i = 0; i < model.count; i += 4) model.at(kOpacityRow, i) = kDead;
    const auto run = [&](std::uint64_t seed, std::uint64_t iteration) {
      OnDevice on(device, model);
      on.relocate(stages, seed, iteration);
      on.grow(stages, 3060, seed);
      return on.download(model);
    };
    const Model first = run(5, 700), again = run(5, 700);
    CHECK(first.params == again.params);
    CHECK(first.moment2 == again.moment2);
    CHECK(run(6, 700).params != first.params);
    CHECK(run(5 + (std::uint64_t{1} << 40), 700).params != first.params);
    CHECK(run(5, 800).params != first.params);
  });
}

TEST_CASE("displaced copies and their sources agree with their formulas in double precision",
          "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    constexpr float kSpread = 0.35f;
    constexpr std::uint64_t kSeed = 99, kIteration = 600;
    constexpr std::uint32_t kCount = 600, kGrown = 700;
    Model model(kCount, kGrown, 0.0f);
    std::mt19937 random(9);
    std::normal_distribution<float> normal;
    // The colour contains the index, so that a copy shows its source.
    constexpr std::size_t kIndexRow = 3;
    for (std::size_t k = 0; k < kRows; ++k)
      for (std::uint32_t i = 0; i < kCount; ++i) model.at(k, i) = normal(random);
    for (std::uint32_t i = 0; i < kCount; ++i) {
      model.at(kIndexRow, i) = static_cast<float>(i);
      if (i % 3 == 1) model.at(kOpacityRow, i) = kDead;
    }
    for (const bool grows : {false, true}) {
      OnDevice on(device, model);
      if (grows)
        on.grow(stages, kGrown, kSeed, kSpread);
      else
        CHECK(on.relocate(stages, kSeed, kIteration, kSpread) == kCount / 3);
      const Model after = on.download(model);
      std::vector<std::uint32_t> slots;
      for (std::uint32_t i = grows ? kCount : 1; i < (grows ? kGrown : kCount); i += grows ? 1 : 3)
        slots.push_back(i);
      std::map<std::uint32_t, int> copies;
      for (const std::uint32_t slot : slots) ++copies[static_cast<std::uint32_t>(after.at(kIndexRow, slot))];
      CHECK(copies.size() > 30);
      SplatModel before(kDim, kCount);
      for (std::size_t k = 0; k < kRows; ++k)
        std::copy_n(&model.params[k * model.stride], kCount, before.row(static_cast<int>(k)).begin());
      const auto check = [&](std::uint32_t splat, const std::vector<double>& expected,
                             const oracle::Displacement& place) {
        for (std::size_t k = 0; k < kRows; ++k) {
          const double error =
              std::abs(after.at(k, splat) - (expected[k] + (k < 3 ? place.displacement[k] : 0)));
          // The largest error observed is 1.8e-7. The positions contain random numbers like those of the
          // noise, so they have its bound.
          if (k < 3)
            REQUIRE(error < 1.7e-5 * (1 + 3 * place.size[k]));
          else
            REQUIRE(error < 3.6e-7 * (1 + std::abs(expected[k])));
        }
      };
      for (const auto& [source, count] : copies)
        check(source, oracle::split(before, source, count, kSpread), {});
      for (const std::uint32_t slot : slots) {
        const auto source = static_cast<std::uint32_t>(after.at(kIndexRow, slot));
        const std::vector<double> raw = oracle::split(before, source, copies[source], kSpread);
        check(slot, raw,
              oracle::place(raw, kDim, before.variant, kSpread,
                            {kSeed, kIteration, grows ? oracle::kGrownPlace : oracle::kRelocatedPlace,
                             grows ? slot - kCount : slot}));
        bool moved = false;
        for (std::size_t k = 0; k < 3; ++k) moved = moved || after.at(k, slot) != after.at(k, source);
        REQUIRE(moved);
      }
    }
  });
}

TEST_CASE("copies of splats with invalid parameters stay at the places of their sources", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    for (const float scale : {1e38f, kNan, -std::numeric_limits<float>::infinity()}) {
      Model model(64, 64, kDead);
      model.at(kOpacityRow, 7) = 1.0f;
      model.at(kScaleRow, 7) = scale;
      model.at(kSkewRow, 7) = 1e38f;
      OnDevice on(device, model);
      CHECK(on.relocate(stages, 1, 600, 0.5f) == 63);
      const Model after = on.download(model);
      for (std::uint32_t i = 0; i < 64; ++i)
        for (std::size_t r = 0; r < 3; ++r) REQUIRE(after.at(r, i) == model.at(r, 7));
    }
  });
}

TEST_CASE("the noise of positions agrees with its formula in double precision", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    Model model(777, 777, 0.0f);
    std::mt19937 random(9);
    std::normal_distribution<float> normal;
    for (std::size_t k = 0; k < kRows; ++k)
      for (std::uint32_t i = 0; i < model.count; ++i) model.at(k, i) = normal(random);
    for (std::uint32_t i = 0; i < model.count; ++i) model.at(kOpacityRow, i) -= 5;
    OnDevice on(device, model);
    const std::uint64_t seed = 123456789012345ull, iteration = 900;
    const double amount = 0.5;
    SplatModel splats(kDim, model.count);
    for (std::size_t k = 0; k < kRows; ++k)
      std::copy_n(&model.params[k * model.stride], model.count, splats.row(static_cast<int>(k)).begin());
    stages.add_noise({on.splats(), static_cast<float>(amount), seed, iteration});
    const Model after = on.download(model);
    for (std::uint32_t i = 0; i < model.count; ++i) {
      const oracle::Displacement noise =
          oracle::noise(splats, i, amount, {seed, iteration, oracle::kNoise, i});
      for (std::size_t r = 0; r < 3; ++r)
        // The largest observed error is 8.5e-6. It occurs if a uniform random number is near 1, because the
        // normal random number that is computed from it is then inexact in single precision.
        REQUIRE(std::abs(after.at(r, i) - (model.at(r, i) + noise.displacement[r])) <
                1.7e-5 * (1 + 3 * noise.size[r]));
      for (std::size_t k = 3; k < kRows; ++k) REQUIRE(after.at(k, i) == model.at(k, i));
    }
  });
}

TEST_CASE("splats with invalid parameters are not moved by noise", "[mcmc][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    Model model(64, 64, -7.0f);
    model.at(kScaleRow, 3) = 1e30f;
    model.at(kSkewRow, 5) = kNan;
    model.at(kOpacityRow, 7) = kNan;
    model.at(kScaleRow + 1, 9) = std::numeric_limits<float>::infinity();
    OnDevice on(device, model);
    stages.add_noise({on.splats(), 1.0f, 1, 1});
    const Model after = on.download(model);
    for (const std::uint32_t i : {3u, 5u, 7u, 9u})
      for (std::size_t r = 0; r < 3; ++r) CHECK(after.at(r, i) == model.at(r, i));
    CHECK(after.at(0, 4) != model.at(0, 4));
  });
}
