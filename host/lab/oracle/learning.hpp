// SPDX-License-Identifier: Apache-2.0
// This file contains the changes that training makes to parameters, in double precision and written from the
// method alone: Adam (4.2), the penalties (4.1) and the noise of 4.3.
#pragma once

#include <array>
#include <cstdint>

#include "host/device/stages.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::oracle {

struct AdamValue {
  double parameter = 0, moment1 = 0, moment2 = 0;
};
// Returns a value after one step with the gradient `g`. `step` is counted from 1.
AdamValue adam(AdamValue before, double g, double rate, std::uint64_t step, double beta1 = 0.9f,
               double beta2 = 0.999f, double epsilon = 1e-15f);

// opacity_penalty() returns the gradient of the mean opacity penalty of `count` splats with respect to the
// raw opacity of one of them. scale_penalty() returns that of the mean scale penalty of `count` splats, each
// with three spatial scales, with respect to one raw scale.
double opacity_penalty(double raw, double weight, std::size_t count);
double scale_penalty(double raw, double weight, std::size_t count);

// Noise holds the displacement of a splat by noise, and the sum of the magnitudes of its terms, which
// determines the rounding error. `iteration` and `seed` are those of AddNoise.
struct Noise {
  std::array<double, 3> displacement{}, size{};
};
Noise noise(const SplatModel& model, std::size_t splat, double amount, std::uint64_t seed,
            std::uint64_t iteration);

}  // namespace ubs::oracle
