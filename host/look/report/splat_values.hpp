// SPDX-License-Identifier: Apache-2.0
// SplatQuantity is one quantity of a model for a histogram, such as the opacities. It contains the activated
// values of all splats of all groups, with a name and a unit.
#pragma once

#include <string>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

struct SplatQuantity {
  std::string name;            // such as "opacity"
  std::string unit;            // label of the axis, such as "scene units" or "exponent of 1 - r"
  std::string meaning;         // explanation in one line
  bool logarithmic = false;    // all values are positive and span orders of magnitude
  bool unit_interval = false;  // all values are in [0, 1]
  std::vector<double> values;
};

// Returns the quantities of a model in this order: opacity, spatial scales, query scales, spatial betas,
// betas and conditioning weights of the query dimensions, colours, means of time. Quantities that the variant
// or the dimensions of the model do not have are omitted. Models of different variants therefore give
// different lists, so quantities must be compared by name.
std::vector<SplatQuantity> splat_quantities(const MixedModel& model);

}  // namespace ubs
