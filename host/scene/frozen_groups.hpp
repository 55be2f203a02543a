// SPDX-License-Identifier: Apache-2.0
// frozen_groups() determines the parameter groups that a run does not train. They have no gradient, no
// moments and no Adam step. A set of groups is stored as a bit mask, in which the bits have the numbers of
// the groups in kernels/layout.h (UBS_FROZEN).
#pragma once

#include <cstdint>
#include <string>

#include "host/scene/splat_model.hpp"

namespace ubs {

// Parses the names of groups of the layout, separated by commas ("xyz,rgb"), and returns their set. An empty
// text gives an empty set. Throws Error(usage) if the model has no group of that name, if a name is repeated,
// or if no parameter would be trained.
std::uint32_t frozen_groups(const ParameterLayout& layout, const std::string& names);
bool is_frozen(std::uint32_t frozen, const std::string& group);
// Returns the number of parameter rows that are trained.
int trained_rows(const ParameterLayout& layout, std::uint32_t frozen);

// SplatGradientNeeds states which gradients of a projected splat are needed to train the groups that are not
// frozen.
struct SplatGradientNeeds {
  bool shape = true;  // mean and conic
  bool opacity = true, beta = true, colour = true;
};
SplatGradientNeeds splat_gradient_needs(const ParameterLayout& layout, std::uint32_t frozen, bool query_grad);

}  // namespace ubs
