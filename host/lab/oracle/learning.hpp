// SPDX-License-Identifier: Apache-2.0
// This file declares the changes that training makes to parameters: Adam, the penalties, copies and noise.
// They are implemented in double precision from their descriptions in docs/method.md (sections 4.2, 4.1
// and 4.3), without code of the kernels.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

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

// Draw identifies random numbers: the seed and iteration of the operation, what they are for, and the number
// of the splat.
struct Draw {
  std::uint64_t seed = 0, iteration = 0;
  std::uint32_t purpose = 0, number = 0;
};
inline constexpr std::uint32_t kNoise = 0x55000003u, kRelocatedPlace = 0x55000004u, kGrownPlace = 0x55000005u;

// Displacement is a random displacement of a splat. `size` holds the sums of the magnitudes of
// the terms of `displacement`; the rounding errors are proportional to them.
struct Displacement {
  std::array<double, 3> displacement{}, size{};
};
// Returns the displacement of a splat by the noise of training.
Displacement noise(const SplatModel& model, std::size_t splat, double amount, const Draw& draw);

// Returns the raw parameters of a splat after `copies` copies of it were made with the setting `spread`.
std::vector<double> split(const SplatModel& model, std::size_t splat, int copies, double spread);
// Returns the displacement of a copy. `raw` are its parameters, which split() has returned for its source.
Displacement place(const std::vector<double>& raw, int dim, const ModelVariant& variant, double spread,
                   const Draw& draw);

}  // namespace ubs::oracle
