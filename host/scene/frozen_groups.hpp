// SPDX-License-Identifier: Apache-2.0
// frozen_groups() determines the parameter groups that a run does not train. They have no gradient, no
// moments and no Adam step. A set of groups is a bit mask with the numbers of kernels/layout.h (UBS_FROZEN).
#pragma once

#include <cstdint>
#include <string>

#include "host/scene/splat_model.hpp"

namespace ubs {

// Parses `names`, which are groups of the layout separated by commas ("xyz,rgb"); empty: none. Throws
// Error(usage) if the model has no group of that name, if a name is repeated, or if nothing would be trained.
std::uint32_t frozen_groups(const ParameterLayout& layout, const std::string& names);
bool is_frozen(std::uint32_t frozen, const std::string& group);
// Returns the number of rows that are trained.
int trained_rows(const ParameterLayout& layout, std::uint32_t frozen);

// The gradients of a projected splat that the trained groups need.
struct SplatGradientNeeds {
  bool shape = true;  // mean and conic
  bool opacity = true, beta = true, colour = true;
};
SplatGradientNeeds splat_gradient_needs(const ParameterLayout& layout, std::uint32_t frozen, bool query_grad);

}  // namespace ubs
