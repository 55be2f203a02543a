// SPDX-License-Identifier: Apache-2.0
// Parameter groups that a run does not learn: they have no gradient, no moments, no Adam step. A set of
// groups is a bit set by the numbers of kernels/layout.h (UBS_FROZEN).
#pragma once

#include <cstdint>
#include <string>

#include "host/scene/splat_model.hpp"

namespace ubs {

// `names`: groups of the layout separated by commas, "xyz,rgb"; empty: none. Throws Error(usage) for a name
// that the model has not, one given twice, and when nothing is left to learn.
std::uint32_t frozen_groups(const ParameterLayout& layout, const std::string& names);
bool is_frozen(std::uint32_t frozen, const std::string& group);
// Rows that are learnt.
int trained_rows(const ParameterLayout& layout, std::uint32_t frozen);

// Which gradients of a projected splat the groups that are learnt ask for.
struct SplatGradientNeeds {
  bool shape = true;  // of its mean and conic
  bool opacity = true, beta = true, colour = true;
};
SplatGradientNeeds splat_gradient_needs(const ParameterLayout& layout, std::uint32_t frozen, bool query_grad);

}  // namespace ubs
