// SPDX-License-Identifier: Apache-2.0
// The share of the time that visitors of a training may cost, on a simulated clock.
#include "host/serve/purse.hpp"

#include <catch2/catch.hpp>

#include "tests/support/simulated_time.hpp"

namespace ubs::serve {
namespace {

// Draws a picture whenever the purse affords it; returns the share of the time that the pictures took.
double drawn_share(double share, double cost, double step, double seconds) {
  test::SimulatedTime time;
  Purse purse(share, time);
  purse.open();
  const double begin = time.seconds();
  double drawn = 0;
  while (time.seconds() - begin < seconds) {
    time.advance(step);
    if (!purse.affords(cost)) continue;
    time.advance(cost);
    purse.spend(cost);
    drawn += cost;
  }
  return drawn / (time.seconds() - begin);
}

TEST_CASE("pictures take their share of the time, however quick steps and pictures are") {
  for (const double step : {1e-4, 0.01, 1.0})
    for (const double cost : {1e-3, 0.1, 5.0}) {
      const double share = drawn_share(0.03, cost, step, 4000);
      INFO("steps of " << step << " s, pictures of " << cost << " s: " << share);
      CHECK(share <= 0.03 * 1.001);
      // There is one picture a step at most.
      const double possible = std::min(0.03, cost / (cost + step));
      CHECK(share > 0.9 * possible);
    }
}

TEST_CASE("after a stop of ten minutes no more is drawn at once than was saved up") {
  test::SimulatedTime time;
  Purse purse(0.03, time);
  purse.open();
  time.advance(600);
  int at_once = 0;
  while (purse.affords(0.07) && at_once < 1000) purse.spend(0.07), ++at_once;
  CHECK(at_once == 4);  // ten seconds are saved up: 0.3 s of drawing
}

}  // namespace
}  // namespace ubs::serve
