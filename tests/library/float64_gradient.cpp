// SPDX-License-Identifier: Apache-2.0
// float64_gradient N COLOUR prints a JSON object for python/tests/test_torch.py. The object contains splats
// with N dimensions and the setting colour = COLOUR, a camera, and a weight for each colour, alpha and depth
// of each pixel. It also contains the gradients of four sums, computed by the oracle in float64: the weighted
// sums of the colours, of the alphas and of the depths, and the total of these three sums.
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "host/settings/fields.hpp"
#include "host/settings/train_settings.hpp"
#include "tests/support/published.hpp"
#include "tests/support/view_number.hpp"

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  ubs::TrainSettings settings = ubs::test::published();
  ubs::set_field(ubs::bind_fields(settings, ubs::train_fields()), "colour", argv[2], "COLOUR");
  const auto [scene, weights] = ubs::test::differentiable_view(std::atoi(argv[1]), 61, 45, settings.variant);
  const ubs::Camera& camera = scene.camera;
  nlohmann::json out{{"values", scene.model.values},
                     {"splats", scene.model.count},
                     {"background", scene.background},
                     {"rotation", camera.rotation},
                     {"translation", camera.translation},
                     {"intrinsics", {camera.fx, camera.fy, camera.cx, camera.cy}},
                     {"size", {camera.width, camera.height}},
                     {"time", camera.time},
                     {"rgb", weights.rgb},
                     {"alpha", weights.alpha},
                     {"depth", weights.depth}};
  const ubs::test::Weights parts[] = {
      {weights.rgb, {}, {}}, {{}, weights.alpha, {}}, {{}, {}, weights.depth}, weights};
  const char* names[] = {"colours", "alpha", "depth", "all"};
  for (int k = 0; k < 4; ++k) {
    const ubs::oracle::ViewGradients gradient = ubs::test::expected_gradient(scene, parts[k], true);
    out["gradients"][names[k]] = {{"parameters", gradient.values}, {"camera", gradient.camera}};
  }
  std::puts(out.dump().c_str());
}
