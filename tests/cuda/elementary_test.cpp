// SPDX-License-Identifier: Apache-2.0
// Compares the logarithm, power and reciprocal that the rasterisers use on CUDA with float64. The
// instructions are emulated with the largest errors that PTX allows (tests/cuda/include/cuda_runtime.h). The
// errors of real GPUs are smaller.
#include <cuda_runtime.h>

#include <catch2/catch.hpp>
#include <cmath>

#include "cuda_backend/cuda_kernels.hpp"

#define UBS_VW 1
#define UBS_N 3

namespace ubs {
namespace {

#include "cuda_backend/shared_math.cuh"

// Returns the largest relative error of `f` at n + 1 points from `from` to `to`. The ratio of neighbouring
// points is constant.
template <typename Function, typename Truth>
double largest_error(const Function& f, const Truth& truth, double from, double to, int n = 2'000'000) {
  double most = 0;
  for (int i = 0; i <= n; ++i) {
    const auto x = static_cast<float>(from * std::pow(to / from, static_cast<double>(i) / n));
    const double exact = truth(static_cast<double>(x));
    const double error = std::abs(static_cast<double>(f(x)) - exact) / std::abs(exact);
    if (!(error <= most)) most = error;  // also true if the error is NaN
  }
  return most;
}

// The comments contain the observed errors.
TEST_CASE("the elementary functions of the CUDA rasterisers are accurate", "[cuda]") {
  const auto log2_1m = [](float r) { return ubs_log2_1m(r); };
  const auto exact_log = [](double r) { return std::log1p(-r) / std::log(2.0); };
  CHECK(largest_error(log2_1m, exact_log, 1e-30, 0.2499) < 3e-7);       // 1.5e-7
  CHECK(largest_error(log2_1m, exact_log, 0.25, 0.99999994) < 1.5e-6);  // 7.5e-7
  CHECK(ubs_log2_1m(0.0f) == 0.0f);
  CHECK(ubs_log2_1m(0.99999994f) == Approx(-24));

  const auto exp2 = [](float y) { return ubs_exp2(-y); };
  const auto exact_exp = [](double y) { return std::exp2(-y); };
  CHECK(largest_error(exp2, exact_exp, 1e-9, 125.9) < 4e-7);  // 3.0e-7
  CHECK(ubs_exp2(-200.0f) == 0.0f);

  const auto reciprocal = [](float x) { return ubs_reciprocal(x); };
  CHECK(largest_error(
            reciprocal, [](double x) { return 1 / x; }, 1e-8, 1) < 1.2e-7);  // 6.0e-8
}

}  // namespace
}  // namespace ubs
