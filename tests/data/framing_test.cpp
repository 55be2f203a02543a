// SPDX-License-Identifier: Apache-2.0
// Cameras for models without data: the up axis, the middle, and that the model is in the picture.
#include "host/scene/framing.hpp"

#include "host/base/philox.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;

namespace {

// A box of 2 x 1 x 3 around (5, -4, 2) on a plate at the low end of `axis` (high end: sign -1), and one stray
// splat.
SplatModel scene(std::size_t axis, int sign, bool plate) {
  SplatModel model(3, 3001);
  const CounterRandom random(1, 1);
  const std::array<double, 3> centre{5, -4, 2}, half{1, 0.5, 1.5};
  for (std::uint32_t i = 0; i < 3000; ++i)
    for (std::uint32_t k = 0; k < 3; ++k) {
      double t = random.uniform(i, k, -1, 1);
      if (plate && k == axis && i % 3 == 0) t = sign * (-1 + 0.01 * t);
      model.row(static_cast<int>(k))[i] = static_cast<float>(centre[k] + half[k] * t);
    }
  for (int k = 0; k < 3; ++k) model.row(k)[3000] = 1e4f;
  return model;
}

}  // namespace

TEST_CASE("framing: a floor tells what is up, nothing does without one", "[framing]") {
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const int sign : {1, -1}) {
      std::array<double, 3> expected{};
      expected[axis] = sign;
      CHECK(guess_up(scene(axis, sign, true), {0, 0, 7}) == expected);
    }
  CHECK(guess_up(scene(0, 1, false), {0, -1, 0}) == std::array<double, 3>{0, -1, 0});
  CHECK(parse_axis("-y") == std::array<double, 3>{0, -1, 0});
  CHECK(message_of([] { parse_axis("up"); }, ErrorKind::usage).size() > 0);
}

TEST_CASE("framing: cameras around the middle see the model upright", "[framing]") {
  const SplatModel model = scene(0, 1, false);
  for (const char* axis : {"x", "-y", "z"}) {
    const auto up = parse_axis(axis);
    const Framing framing = frame_model(model, up);
    CHECK(std::abs(framing.centre[0] - 5) < 0.1);
    CHECK(std::abs(framing.centre[1] + 4) < 0.1);
    for (const Camera& c : framing_cameras(framing, 5, 90, 60)) {
      const auto project = [&](const std::array<double, 3>& p) {
        std::array<double, 3> q = c.translation;
        for (std::size_t r = 0; r < 3; ++r)
          for (std::size_t k = 0; k < 3; ++k) q[r] += c.rotation[3 * r + k] * p[k];
        return std::array<double, 3>{c.fx * q[0] / q[2] + c.cx, c.fy * q[1] / q[2] + c.cy, q[2]};
      };
      const auto middle = project(framing.centre);
      CHECK(middle[0] == Approx(45));
      CHECK(middle[1] == Approx(30));
      std::array<double, 3> above = framing.centre;
      for (std::size_t k = 0; k < 3; ++k) above[k] += 0.3 * up[k];
      CHECK(project(above)[1] < 29);
      CHECK(project(above)[0] == Approx(45));
      int outside = 0;
      for (std::size_t i = 0; i < 3000; ++i) {
        const auto p = project({model.row(0)[i], model.row(1)[i], model.row(2)[i]});
        outside += !(p[2] > 0 && p[0] > 0 && p[0] < 90 && p[1] > 0 && p[1] < 60);
      }
      CHECK(outside < 60);
    }
  }
  CHECK_THAT(message_of([] { frame_model(SplatModel(3, 0), {0, 0, 1}); }), Catch::Contains("no splats"));
}
