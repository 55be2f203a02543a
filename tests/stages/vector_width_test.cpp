// SPDX-License-Identifier: Apache-2.0
// Tests the vector widths that ubs uses on other devices: 8 with AVX2, 4 with NEON and SSE, 1 on GPUs. With
// each of them, the gradient of a view must be equal to the one for the device's own width, except for
// rounding.
#include <catch2/catch.hpp>

#include "host/lab/oracle/scenes.hpp"
#include "host/opencl/platform.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "tests/support/compare.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

std::vector<float> gradient_at_width(std::size_t device_index, unsigned width, const oracle::Scene& scene) {
  const auto device = opencl::open_device(device_index, width);
  const auto stages = make_stages(*device, {.dim = scene.model.dim});
  const std::vector<float> target(scene.target.begin(), scene.target.end());
  return view_gradient(*device, *stages, scene.model, scene.camera, target, {}, 0.2f).values.values;
}

TEST_CASE("every vector width gives the same gradient", "[stages]") {
  if (opencl_devices_under_test().empty()) return;  // with --cuda-on-host, the same test would be repeated
  const std::vector<DeviceInfo> devices = opencl::list_devices();
  for (std::size_t i = 0; i < devices.size(); ++i) {
    for (const int dim : {3, 4, 7}) {
      // N = 4 uses all functions and compiles in a third of the time of N = 7.
      if (dim != 4 && !test::whole_sweep()) continue;
      const oracle::Scene scene =
          oracle::regular_scene({.count = 150, .dim = dim, .seed = 11, .width = 45, .height = 38});
      const std::vector<float> own = gradient_at_width(i, 0, scene);
      const std::vector<double> reference(own.begin(), own.end());
      for (const unsigned width : {16u, 8u, 4u, 1u}) {
        const double error = test::relative_error(gradient_at_width(i, width, scene), reference);
        INFO(devices[i].name << ", N = " << dim << ", width " << width << ": " << error);
        CHECK(error < 2e-5);
      }
    }
  }
}

}  // namespace
}  // namespace ubs
