// SPDX-License-Identifier: Apache-2.0
// This file declares the changes that training makes to parameters: Adam, the penalties and the noise. They
// are implemented in double precision from their descriptions in docs/method.md (sections 4.2, 4.1 and 4.3),
// without code of the kernels.
#pragma once

#include <array>
#include <cstdint>

#include "host/device/stages.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::oracle {

struct AdamValue {
  double parameter = 0, moment1 = 0, moment2 = 0;
};
// Returns the parameter and its moments after one step of Adam with the gradient `g`. `step` is counted from
// 1.
AdamValue adam(AdamValue before, double g, double rate, std::uint64_t step, double beta1 = 0.9f,
               double beta2 = 0.999f, double epsilon = 1e-15f);

// opacity_penalty() returns the gradient of the mean opacity penalty of `count` splats with respect to the
// raw opacity of one of them. scale_penalty() returns the gradient of the mean scale penalty of `count`
// splats, each with three spatial scales, with respect to one raw scale.
double opacity_penalty(double raw, double weight, std::size_t count);
double scale_penalty(double raw, double weight, std::size_t count);

// Noise is the displacement of a splat by the noise of training. `size` holds the sums of the magnitudes of
// the terms of `displacement`; the rounding errors are proportional to them.
struct Noise {
  std::array<double, 3> displacement{}, size{};
};
// `iteration` and `seed` have the same meaning as in AddNoise.
Noise noise(const SplatModel& model, std::size_t splat, double amount, std::uint64_t seed,
            std::uint64_t iteration);

}  // namespace ubs::oracle
