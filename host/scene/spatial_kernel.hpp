// SPDX-License-Identifier: Apache-2.0
// The table of spatial kernels. The kernel is the factor of a splat's opacity at the squared distance r from
// its mean. Code that treats kernels differently asks for a property of this table, so that it is right for
// every kernel, or fails with a message. The formulas are in kernels/math/falloff.h, and the numbers that
// they need in kernels/variant.h; falloffs that a user defines (OwnFalloff) are not in this table.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace ubs {

enum class SpatialKernel { beta, gaussian };

struct SpatialKernelRow {
  const char* name;  // value of the setting `kernel`
  // Each splat has a raw value b. The kernel depends on beta = 4 exp(b).
  bool has_beta;
  // Unit of the spatial scales: the radius of the support, or, if false, the standard deviation.
  bool scale_is_support;
  // The initial scale of a splat is the distance of its neighbours divided by this ratio.
  double initial_ratio;
  double lr_opacity, lr_scale;  // automatic learning rates
  // Returns the ratio of the scale to the standard deviation of the closest Gaussian (docs/method.md, section
  // 2.7). Null if the kernel cannot be replaced by a Gaussian, so that models cannot be exported as
  // Gaussians.
  double (*gaussian_ratio)(double beta);
  const char* beta_formula;  // what beta is in the kernel, and
  const char* beta_meaning;  // how it changes the shape; null without beta
};

// Returns the ratio of the support radius of (1 - r)^beta to the standard deviation of the nearest Gaussian.
// For beta = 4 and beta = 29.6, the formula differs by less than 0.5 % from the ratios 3.08 and 7.78 of
// method.md 2.7, which minimise the largest difference between the two kernels.
inline double support_ratio(double beta) { return std::sqrt(2 * beta + 1.49); }

// The rows are in the order of SpatialKernel, whose numbers are those of UBS_FALLOFF.
inline constexpr std::array kSpatialKernels{
    SpatialKernelRow{
        .name = "beta",
        .has_beta = true,
        .scale_is_support = true,
        .initial_ratio = 1,
        .lr_opacity = 0.05,
        .lr_scale = 0.005,
        .gaussian_ratio = support_ratio,
        .beta_formula = "exponent of 1 - r",
        .beta_meaning =
            "4 exp(b); low: flat with a hard edge, 4: similar to a Gaussian, high: a narrow peak"},
    // initial_ratio: 3.08 is the ratio of support radius to standard deviation for the Gaussian that is
    // closest to (1 - r)^4 (method.md 2.7). With a ratio of 1, as in 3DGS, the initial splats overlap so much
    // that they hide each other. A training run on lego_200 with a ratio of 1, with 30 000 random points and
    // the learning rates of the Beta kernel, reached only 9.8 dB.
    //
    // Learning rates: pixels where the alpha of a Gaussian is below 1/255 contribute no gradient, so
    // opacities must not decrease faster than the sizes of splats can adapt. lr_opacity = 0.025 is the rate
    // that 3DGS uses today. For scales, 3DGS uses a rate of 0.005 (for ln sigma), but it starts from the
    // points of a reconstruction. With random points on lego_200, training is faster with 0.02
    // (docs/results/2026-11-21-accuracy.md).
    SpatialKernelRow{.name = "gaussian",
                     .has_beta = false,
                     .scale_is_support = false,
                     .initial_ratio = 3.08,
                     .lr_opacity = 0.025,
                     .lr_scale = 0.02,
                     .gaussian_ratio = [](double) { return 1.0; },
                     .beta_formula = nullptr,
                     .beta_meaning = nullptr},
};

constexpr const SpatialKernelRow& row_of(SpatialKernel kernel) {
  return kSpatialKernels.at(static_cast<std::size_t>(kernel));
}

// The names of all kernels, separated by |.
inline constexpr auto kSpatialKernelNames = [] {
  std::array<char, 256> text{};
  std::size_t end = 0;
  for (const SpatialKernelRow& row : kSpatialKernels) {
    if (end > 0) text.at(end++) = '|';
    for (const char* c = row.name; *c != '\0'; ++c) text.at(end++) = *c;
  }
  return text;
}();

}  // namespace ubs
