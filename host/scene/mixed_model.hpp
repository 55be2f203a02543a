// SPDX-License-Identifier: Apache-2.0
// A model whose splats do not all have the same dimensions: groups, each a SplatModel of its own N. Splats
// are numbered through in the order of the groups. All groups are of one form (variant): they are drawn into
// one image by one rasteriser.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs {

struct MixedModel {
  std::vector<SplatModel> groups;  // at least one; no two of the same N

  MixedModel() : groups(1) {}
  MixedModel(SplatModel model) { groups.push_back(std::move(model)); }
  explicit MixedModel(std::vector<SplatModel> several) : groups(std::move(several)) {}

  bool mixed() const { return groups.size() > 1; }
  int dim() const { return groups.front().dim; }  // of the first group: the largest in files of ours
  const ModelVariant& variant() const { return groups.front().variant; }
  bool has_time() const;           // whether any of its splats changes with time
  std::size_t count() const;       // splats
  std::size_t parameters() const;  // floats
  // The only group. Throws Error(usage): "<what>: the model has splats of several dimensions ...".
  const SplatModel& single(std::string_view what) const;
};

// "N = 6, 1200 splats"; "N = 6: 700, N = 3: 500, 1200 splats".
std::string to_string(const MixedModel& model);

// Throws Error(kind internal) where groups are missing, repeat a dimension or differ in form.
void check_groups(const MixedModel& model);

}  // namespace ubs
