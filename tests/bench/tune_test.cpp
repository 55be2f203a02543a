// SPDX-License-Identifier: Apache-2.0
// Tests which values of tuned constants `ubs-lab tune` chooses. The times are simulated. Each value changes
// the time by a factor that does not depend on the values of the other constants.
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>

#include "host/base/error.hpp"
#include "host/lab/bench/tuner.hpp"

namespace ubs::bench {
namespace {

const std::vector<TunedConstant> kTable{
    {"A", 0, {1, 2, 3}, "a", RasterKind::gpu, {"x"}},
    {"OTHER", 0, {1}, "b", RasterKind::cpu, {"x"}},
    {"B", 8, {4, 16}, "c", RasterKind::gpu, {"x", "y"}},
};

// The behaviour of the simulated device.
struct Given {
  // The factor by which a value that is not the default multiplies the time.
  std::map<std::pair<std::string, unsigned>, double> factor;
  // The amount by which a value changes the outputs.
  std::map<std::pair<std::string, unsigned>, float> result;
  std::pair<std::string, unsigned> refused{"", 0};  // the value with which kernels cannot be created
  ErrorKind refusal = ErrorKind::device;            // the kind of the error in this case
  double noise = 0;                                 // relative additional time of every third call
  std::vector<TuningValues> made;                   // all combinations of values that have been tried
};

class GivenSubject final : public TuneSubject {
 public:
  GivenSubject(Given& given, const TuningValues& values) : given_(given), values_(values) {
    given.made.push_back(values);
    for (const auto& [macro, value] : values)
      if (given.refused == std::pair(macro, value)) fail(given.refusal, "too\nmuch");
  }
  Parts outputs() override {
    float sum = 1;
    for (const auto& value : values_)
      if (const auto found = given_.result.find(value); found != given_.result.end()) sum += found->second;
    return {{sum}};
  }
  double time_ms(const std::string& stage, int) override {
    double time = stage == "x" ? 10 : 2;
    for (const auto& value : values_)
      if (const auto found = given_.factor.find(value); found != given_.factor.end()) time *= found->second;
    return ++calls_ % 3 == 0 ? time * (1 + given_.noise) : time;
  }

 private:
  Given& given_;
  TuningValues values_;
  int calls_ = 0;
};

struct Chosen {
  TuningValues values;
  std::vector<Trial> trials;
  const Trial& of(const std::string& macro, unsigned value) const {
    const auto found =
        std::ranges::find_if(trials, [&](const Trial& t) { return t.macro == macro && t.value == value; });
    REQUIRE(found != trials.end());
    return *found;
  }
};
Chosen choose(Given& given, TuneOptions options = {.raster = RasterKind::gpu, .on_trial = {}}) {
  Chosen chosen;
  options.on_trial = [&](const Trial& trial) { chosen.trials.push_back(trial); };
  chosen.values = choose_values(
      kTable, [&](const TuningValues& values) { return std::make_unique<GivenSubject>(given, values); },
      options);
  return chosen;
}

TEST_CASE("tune keeps the fastest value of each constant, combined with the constants chosen before") {
  Given given{
      .factor = {{{"A", 1}, 0.9}, {{"A", 2}, 0.8}, {{"A", 3}, 1.1}, {{"B", 4}, 0.99}, {{"B", 16}, 0.5}}};
  const Chosen chosen = choose(given);
  CHECK(chosen.values == TuningValues{{"A", 2}, {"B", 16}});
  CHECK(chosen.trials.size() == 5);  // one per candidate; constants of the other rasteriser are not tried
  CHECK(chosen.of("A", 2).kept);
  CHECK(chosen.of("A", 2).ms == Approx(8));
  CHECK(chosen.of("A", 2).before_ms == Approx(10));
  CHECK_FALSE(chosen.of("A", 1).kept);
  CHECK(chosen.of("A", 3).ratio == Approx(1.1));
  CHECK(chosen.of("B", 4).ratio == Approx(0.99));  // not kept, because it saves less than 2 %
  CHECK(chosen.of("B", 16).before_ms == Approx(0.8 * 12));
  CHECK(std::ranges::find(given.made, TuningValues{{"A", 2}, {"B", 16}}) != given.made.end());
}

TEST_CASE("tune only chooses values that are significantly faster than the default") {
  Given given;
  CHECK(choose(given).values.empty());
  given.factor = {{{"A", 1}, 0.97}, {{"B", 4}, 1.2}, {{"B", 16}, 0.985}};
  CHECK(choose(given).values == TuningValues{{"A", 1}});
  given.noise = 1.0;
  CHECK(choose(given).values.empty());
}

TEST_CASE("tune rejects values that change results or fail") {
  Given given{.factor = {{{"A", 1}, 0.9}, {{"A", 2}, 0.5}, {{"B", 16}, 0.5}},
              .result = {{{"A", 2}, 1e-3f}},
              .refused = {"B", 16}};
  const Chosen chosen = choose(given);
  CHECK(chosen.values == TuningValues{{"A", 1}});
  CHECK(chosen.of("A", 2).note == "results differ by 1.0e-03");
  CHECK(chosen.of("B", 16).note == "does not run on this device: too");
  given.refusal = ErrorKind::internal;
  CHECK_THROWS_AS(choose(given), Error);
}

TEST_CASE("tune starts no trial after its time limit") {
  Given given{.factor = {{{"A", 1}, 0.5}}};
  const Chosen chosen = choose(given, {.raster = RasterKind::gpu, .max_seconds = 0, .on_trial = {}});
  CHECK(chosen.values.empty());
  CHECK(chosen.trials.size() == 5);
  for (const Trial& trial : chosen.trials) {
    CHECK(trial.skipped);
    CHECK(trial.note == "not tried: no time left");
  }
  CHECK(given.made.size() == 1);
}

}  // namespace
}  // namespace ubs::bench
