// SPDX-License-Identifier: Apache-2.0
// The parameters of a model as what they mean: activated values by quantity, with a name and a unit, over all
// splats of all groups. For histograms.
#pragma once

#include <string>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

struct SplatQuantity {
  std::string name;            // "opacity"
  std::string unit;            // of the axis: "scene units", "exponent of 1 - r"
  std::string meaning;         // one line
  bool logarithmic = false;    // all values are positive and spread over magnitudes
  bool unit_interval = false;  // all values lie in [0, 1]
  std::vector<double> values;
};

// What the model has, in an order for reading: opacity, spatial scales, betas, conditioning weights, query
// scales, colours, means of time. Quantities of which the form of the model or its dimensions know nothing
// are left out. Models of different forms give different lists: compare by name.
std::vector<SplatQuantity> splat_quantities(const MixedModel& model);

}  // namespace ubs
