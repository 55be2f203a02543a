// SPDX-License-Identifier: Apache-2.0
// Compares every math mode (host/scene/math_mode.hpp) on every device with the float64 oracle. The error of
// each mode must stay within its bound, the approximate modes must have an effect, and the errors must arise
// in the stages that compute powers.
#include <catch2/catch.hpp>

#include "host/check/stage_run.hpp"
#include "host/lab/accuracy/truth.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/opencl/opencl_device.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs::accuracy {
namespace {

using check::ErrorSum;
using check::StageErrors;
using check::StageRun;

Problem problem(int dim) {
  const oracle::Scene scene =
      oracle::regular_scene({.count = 250, .dim = dim, .seed = 31, .width = 61, .height = 45});
  Problem p;
  p.model = scene.model;
  // A larger beta would make the kernel steep at the end of its support. The resulting large gradients would
  // hide the errors that these tests look for.
  for (float& b : p.model.row(p.model.layout().beta)) b = std::max(b, -0.5f);
  p.camera = scene.camera;
  p.target.assign(scene.target.begin(), scene.target.end());
  for (std::size_t c = 0; c < 3; ++c) p.background[c] = static_cast<float>(scene.background[c]);
  return p;
}

struct Expectation {
  MathMode math;
  double image, gradient;  // bounds of the relative 2-norms, about twice the largest errors observed on PoCL
  bool coarser;            // whether the error of the image must be larger than that of the default mode
};

std::vector<Expectation> expectations() {
  return {{MathMode::exact, 6.5e-7, 5.0e-6, false},  // observed 3.3e-7 and 2.5e-6
          {MathMode::native, 4.4e-6, 2.1e-5, true},
          {MathMode::rough, 1.8e-4, 7.9e-4, true}};
}

double image_error(const StageRun& run, const Truth& truth) {
  ErrorSum sum;
  sum.add(run.image(), truth.image);
  return sum.errors().relative;
}

TEST_CASE("approximations stay within their bounds", "[accuracy]") {
  const Problem p = problem(3);
  const Truth truth = compute_truth(p);
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device))
      for (const Expectation& e : expectations()) {
        KernelConfig config{.dim = 3, .raster = raster};
        config.math = e.math;
        StageRun run(*device, config, p);
        const double image = image_error(run, truth);
        const auto groups = check::group_errors(p.model.layout(), p.model.count,
                                                run.gradient_of(truth.v_image), truth.gradient);
        const double gradient = worst(groups).errors.relative;
        UNSCOPED_INFO(device->info().name
                      << ", raster " << (raster == RasterKind::cpu ? "cpu" : "gpu") << ", "
                      << "math " << static_cast<int>(e.math) << ": image " << image << ", gradient "
                      << gradient << " (" << worst(groups).quantity << ")");
        CHECK(image <= e.image);
        CHECK(gradient <= e.gradient);
        // In the gpu rasteriser, `native` and `rough` use a function of the device, which may be accurate.
        if (e.coarser && !(raster == RasterKind::gpu && e.math != MathMode::exact)) CHECK(image > 1e-6);
      }
}

TEST_CASE("approximations increase the errors of the stages that compute powers", "[accuracy]") {
  const Problem p = problem(3);  // N = 3, because its kernels have been compiled for the test above
  const StageTruth truth = compute_stage_truth(p);
  for (const auto& device : devices_under_test()) {
    const auto errors = [&](MathMode math) {
      KernelConfig config{.dim = 3};
      config.math = math;
      std::vector<double> all;
      for (const StageErrors& s : StageRun(*device, config, p).stage_errors(truth)) {
        all.push_back(worst(s.quantities).errors.relative);
        UNSCOPED_INFO(device->info().name << ", "
                                          << "math " << static_cast<int>(math) << ", " << s.stage << ": "
                                          << all.back() << " (" << worst(s.quantities).quantity << ")");
      }
      return all;
    };
    const std::vector<double> exact = errors(MathMode::exact), rough = errors(MathMode::rough);
    REQUIRE(exact.size() == 5);
    for (const double e : exact) CHECK(e < 1e-5);
    CHECK(rough[2] == exact[2]);  // the loss computes no powers
    // With one lane, the projection uses the exact functions of the device.
    const bool lanes = device->info().float_vector_width > 1;
    for (const std::size_t stage : {0u, 4u}) CHECK((rough[stage] > exact[stage]) == lanes);
    for (const std::size_t stage : {1u, 3u}) CHECK(rough[stage] > exact[stage]);
  }
}

TEST_CASE("the exact math mode adds no options for the compilation of kernels", "[accuracy]") {
  CHECK(arithmetic_options(MathMode::exact).empty());
}

}  // namespace
}  // namespace ubs::accuracy
