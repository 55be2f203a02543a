// SPDX-License-Identifier: Apache-2.0
#include "host/scene/frozen_groups.hpp"

#include <algorithm>
#include <string_view>
#include <vector>

#include "host/base/error.hpp"

namespace ubs {
namespace {

std::uint32_t bit_of(std::string_view group) {
  for (const GroupName& g : kParameterGroups)
    if (g.name == group) return 1u << g.number;
  fail(ErrorKind::internal, "parameter group '{}' is not in kParameterGroups", group);
}

std::vector<std::string> split_names(const std::string& names) {
  std::vector<std::string> out;
  for (std::size_t at = 0; !names.empty() && at <= names.size();) {
    const std::size_t end = std::min(names.find(',', at), names.size());
    out.push_back(names.substr(at, end - at));
    at = end + 1;
  }
  return out;
}

}  // namespace

std::uint32_t frozen_groups(const ParameterLayout& layout, const std::string& names) {
  std::vector<ParameterGroup> groups = parameter_groups(layout);
  std::erase_if(groups, [](const ParameterGroup& g) { return g.count == 0; });
  std::uint32_t frozen = 0;
  for (const std::string& name : split_names(names)) {
    std::string known;
    bool found = false;
    for (const ParameterGroup& g : groups) {
      known += (known.empty() ? "" : ", ") + g.name;
      found |= g.name == name;
    }
    if (!found)
      fail(ErrorKind::usage, "freeze = '{}': '{}' is not a parameter group of this model ({})", names, name,
           known);
    if (frozen & bit_of(name)) fail(ErrorKind::usage, "freeze = '{}': '{}' is given twice", names, name);
    frozen |= bit_of(name);
  }
  if (trained_rows(layout, frozen) == 0)
    fail(ErrorKind::usage, "freeze = '{}': no parameter would be trained", names);
  return frozen;
}

bool is_frozen(std::uint32_t frozen, const std::string& group) { return (frozen & bit_of(group)) != 0; }

int trained_rows(const ParameterLayout& layout, std::uint32_t frozen) {
  int rows = 0;
  for (const ParameterGroup& g : parameter_groups(layout))
    if (!is_frozen(frozen, g.name)) rows += g.count;
  return rows;
}

SplatGradientNeeds splat_gradient_needs(const ParameterLayout& layout, std::uint32_t frozen,
                                        bool query_grad) {
  const auto learns = [&](const char* group) { return !is_frozen(frozen, group); };
  SplatGradientNeeds needs;
  // The betas of query dimensions are weights of the conditioning, so they change the mean and the covariance
  // of a splat.
  needs.shape = learns("xyz") || learns("scale") || learns("l_triangle") ||
                (layout.query > 0 && (learns("mean") || (layout.variant.has_query_beta() && learns("beta"))));
  needs.opacity = needs.shape || learns("opacity");
  needs.beta = layout.variant.has_spatial_beta() && learns("beta");
  const bool directed = layout.variant.harmonics() > 1 || layout.variant.lobes() > 0;
  needs.colour = learns("rgb") || (directed && (learns("sh_rest") || (query_grad && learns("xyz"))));
  return needs;
}

}  // namespace ubs
