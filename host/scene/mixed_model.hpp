// SPDX-License-Identifier: Apache-2.0
// MixedModel is a model whose splats may have different dimensions. It consists of groups, each of which is a
// SplatModel with its own N. Splats are numbered consecutively in the order of the groups. All groups have
// the same variant, because one rasteriser renders them into one image.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs {

struct MixedModel {
  std::vector<SplatModel> groups;  // at least one; each N occurs at most once

  MixedModel() : groups(1) {}
  MixedModel(SplatModel model) { groups.push_back(std::move(model)); }
  explicit MixedModel(std::vector<SplatModel> several) : groups(std::move(several)) {}

  bool mixed() const { return groups.size() > 1; }
  // Returns N of the first group. In files written by ubs, this is the group with the most splats.
  int dim() const { return groups.front().dim; }
  const ModelVariant& variant() const { return groups.front().variant; }
  bool has_time() const;           // returns whether any group has a time dimension
  std::size_t count() const;       // number of splats
  std::size_t parameters() const;  // number of floats
  // Returns the only group. Throws Error(usage) with a message that starts with `what` if there are several
  // groups.
  const SplatModel& single(std::string_view what) const;
};

// Returns, for example, "N = 6, 1200 splats", or "N = 6: 700, N = 3: 500, 1200 splats" for several groups.
std::string to_string(const MixedModel& model);

// Throws Error(internal) if there are no groups, or if groups have the same dimension or different variants.
void check_groups(const MixedModel& model);

}  // namespace ubs
