// SPDX-License-Identifier: Apache-2.0
// Compares the elementary functions of the kernels with float64, on every OpenCL device and for every vector
// width. The bounds are the errors that kernels/README.md states. tests/cuda/elementary_test.cpp tests the
// functions of the CUDA back end.
#include <bit>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "host/opencl/opencl_device.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/kernel_folder.hpp"

namespace ubs {
namespace {

using namespace opencl;

using Function = double (*)(double);

// Returns the values of the function with the number `which` (tests/support/elementary_probe.cl) at the
// points `x`. Their number must be a multiple of 16.
std::vector<float> values(OpenclDevice& device, Kernel& kernel, int lanes, int which,
                          const std::vector<float>& x) {
  Buffer<float> in(device, "in", x.size()), out(device, "out", x.size());
  in.upload(x);
  kernel({x.size() / static_cast<std::size_t>(lanes)}, {1}, which, in.view(), out.view());
  return out.download();
}

// Returns the largest relative error of a function at 2^19 points from `from` to `to`, with equal ratios
// between neighbours.
double largest_error(OpenclDevice& device, Kernel& kernel, int lanes, int which, Function truth, double from,
                     double to) {
  std::vector<float> x(std::size_t{1} << 19);
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] = static_cast<float>(from *
                              std::pow(to / from, static_cast<double>(i) / static_cast<double>(x.size())));
  const std::vector<float> f = values(device, kernel, lanes, which, x);
  double most = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double exact = truth(static_cast<double>(x[i]));
    const double error = std::abs(static_cast<double>(f[i]) - exact) / std::abs(exact);
    if (!(error <= most)) most = error;  // also sets `most` if the error is NaN
  }
  return most;
}

// The comment after each bound is the largest error that was observed for any vector width, with PoCL on an
// Intel Xeon with AVX-512.
TEST_CASE("elementary functions have at most the documented errors") {
  const test::KernelFolder folder;
  for (const auto& shared : opencl_devices_under_test())
    for (const int lanes : {1, 4, 8, 16}) {
      auto& device = dynamic_cast<OpenclDevice&>(*shared);
      Kernel kernel =
          device.kernel({{"../tests/support/elementary_probe.cl"}, {fmt::format("-DUBS_VW={}", lanes)}},
                        "elementary_probe");
      INFO(device.info().name << ", " << lanes << " lanes");
      const auto error = [&](int which, Function truth, double from, double to) {
        return largest_error(device, kernel, lanes, which, truth, from, to);
      };
      const Function log2_1m = [](double r) { return std::log1p(-r) / std::log(2.0); };
      CHECK(error(0, log2_1m, 1e-30, 0.2499) < 3e-7);      // 1.5e-7
      CHECK(error(0, log2_1m, 0.25, 0.9999999) < 1.5e-6);  // 7.5e-7
      const Function exp2 = [](double y) { return std::exp2(y); };
      CHECK(error(1, exp2, -1e-9, -125.9) < 4e-7);  // 3.0e-7
      const Function reciprocal = [](double x) { return 1 / x; };
      CHECK(error(2, reciprocal, 1e-8, 1) < 1.2e-7);  // 6.0e-8
      const Function exp = [](double x) { return std::exp(x); };
      CHECK(error(3, exp, 1e-9, 88.3) < 1.6e-7);    // 8.2e-8
      CHECK(error(3, exp, -1e-9, -87.3) < 1.6e-7);  // 8.2e-8
      const Function log1p = [](double x) { return std::log1p(x); };
      CHECK(error(4, log1p, 1e-30, 1) < 5.1e-7);  // 2.6e-7
      constexpr float kInf = std::numeric_limits<float>::infinity();
      std::vector<float> ends(16, std::numeric_limits<float>::quiet_NaN());
      ends[0] = kInf, ends[1] = -kInf, ends[2] = 1e30f, ends[3] = -1e30f, ends[4] = 89, ends[5] = -104;
      ends[6] = std::bit_cast<float>(0x7fffffffu);  // a NaN: all bits except the sign are set
      const std::vector<float> at_ends = values(device, kernel, lanes, 3, ends);
      for (std::size_t i = 0; i < ends.size(); ++i)
        CHECK((i > 5 ? std::isnan(at_ends[i]) : at_ends[i] == (ends[i] > 0 ? kInf : 0.0f)));
    }
}

}  // namespace
}  // namespace ubs
