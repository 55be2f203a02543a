// SPDX-License-Identifier: Apache-2.0
// What training does to parameters, in double and from the method alone: Adam (4.2), the penalties (4.1), and
// the noise of 4.3.
#pragma once

#include <array>
#include <cstdint>

#include "host/device/stages.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::oracle {

struct AdamValue {
  double parameter = 0, moment1 = 0, moment2 = 0;
};
// One step of a value with gradient `g`; `step` counts from 1.
AdamValue adam(AdamValue before, double g, double rate, std::uint64_t step, double beta1 = 0.9f,
               double beta2 = 0.999f, double epsilon = 1e-15f);

// Gradient of a penalty's mean over `count` splats with respect to the raw opacity, or over their three
// spatial scales with respect to a raw one.
double opacity_penalty(double raw, double weight, std::size_t count);
double scale_penalty(double raw, double weight, std::size_t count);

// By how much noise moves a splat, and the sum of the sizes of what is added up for it, which rounding goes
// by. `iteration` and `seed` as in AddNoise.
struct Noise {
  std::array<double, 3> displacement{}, size{};
};
Noise noise(const SplatModel& model, std::size_t splat, double amount, std::uint64_t seed,
            std::uint64_t iteration);

}  // namespace ubs::oracle
