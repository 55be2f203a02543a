// SPDX-License-Identifier: Apache-2.0
// Logarithm, power and reciprocal of kernels of one lane on every device against float64, with the errors
// that docs/accuracy.md states (on CUDA: tests/cuda/elementary_test.cpp).
#include <catch2/catch.hpp>
#include <cmath>

#include "host/opencl/opencl_device.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/kernel_folder.hpp"

namespace ubs {
namespace {

using namespace opencl;

using Function = double (*)(double);

// At points from `from` to `to`, as many to an octave throughout.
double largest_error(OpenclDevice& device, Kernel& kernel, int which, Function truth, double from,
                     double to) {
  Buffer<float> in(device, "in", 1 << 19), out(device, "out", in.size());
  std::vector<float> x(in.size());
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] = static_cast<float>(from *
                              std::pow(to / from, static_cast<double>(i) / static_cast<double>(x.size())));
  in.upload(x);
  kernel({x.size()}, {64}, which, in.view(), out.view());
  const std::vector<float> f = out.download();
  double most = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double exact = truth(static_cast<double>(x[i]));
    const double error = std::abs(static_cast<double>(f[i]) - exact) / std::abs(exact);
    if (!(error <= most)) most = error;  // NaN too
  }
  return most;
}

TEST_CASE("elementary functions of one lane are as exact as is stated") {
  const test::KernelFolder folder;
  for (const auto& shared : opencl_devices_under_test()) {
    auto& device = dynamic_cast<OpenclDevice&>(*shared);
    Kernel kernel =
        device.kernel({{"../tests/support/elementary_probe.cl"}, {"-DUBS_VW=1"}}, "elementary_probe");
    INFO(device.info().name);
    const Function log2_1m = [](double r) { return std::log1p(-r) / std::log(2.0); };
    CHECK(largest_error(device, kernel, 0, log2_1m, 1e-30, 0.2499) < 3e-7);      // 1.5e-7
    CHECK(largest_error(device, kernel, 0, log2_1m, 0.25, 0.9999999) < 1.5e-6);  // 7.5e-7
    const Function exp2 = [](double y) { return std::exp2(y); };
    CHECK(largest_error(device, kernel, 1, exp2, -1e-9, -125.9) < 4e-7);  // 3.0e-7
    const Function reciprocal = [](double x) { return 1 / x; };
    CHECK(largest_error(device, kernel, 2, reciprocal, 1e-8, 1) < 1.2e-7);  // 6.0e-8
  }
}

}  // namespace
}  // namespace ubs
