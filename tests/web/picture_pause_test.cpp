// SPDX-License-Identifier: Apache-2.0
// Tests PicturePause, which limits the share of the training time that images for viewers take, with a
// simulated clock.
#include "host/look/serve/picture_pause.hpp"

#include <algorithm>
#include <catch2/catch.hpp>

#include "tests/support/simulated_time.hpp"

namespace ubs::serve {
namespace {

// Simulates training steps of `step` seconds. Renders an image, which takes `cost` seconds, whenever the
// pause is over. Returns the share of the time that the images took.
double drawn_share(double share, double cost, double step, double seconds) {
  test::SimulatedTime time;
  PicturePause pause(share, time);
  const double begin = time.seconds();
  double drawn = 0;
  while (time.seconds() - begin < seconds) {
    time.advance(step);
    if (!pause.over()) continue;
    time.advance(cost);
    pause.begin(cost);
    drawn += cost;
  }
  return drawn / (time.seconds() - begin);
}

TEST_CASE("images take their share of the time, for any speed of steps and images") {
  for (const double step : {1e-4, 0.01, 1.0})
    for (const double cost : {1e-3, 0.1, 5.0}) {
      const double share = drawn_share(0.03, cost, step, 4000);
      INFO("steps of " << step << " s, images of " << cost << " s: " << share);
      CHECK(share <= 0.03 + cost / 4000);  // there is no pause before the first image
      // An image is only rendered after the step during which the pause ends, so the share may be lower.
      CHECK(share > 0.99 * cost / (cost / 0.03 + step));
    }
}

TEST_CASE("the pause after an image depends only on the cost of this image") {
  test::SimulatedTime time;
  PicturePause pause(0.03, time);
  CHECK(pause.over());
  pause.begin(1e-3);
  CHECK(!pause.over());
  time.advance(1e-3 * 0.97 / 0.03 + 1e-6);
  CHECK(pause.over());  // the cost of the next image does not matter
  time.advance(600);
  pause.begin(0.1);
  CHECK(!pause.over());
}

}  // namespace
}  // namespace ubs::serve
