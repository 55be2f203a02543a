// SPDX-License-Identifier: Apache-2.0
// This file implements splat_model.hpp: the rows, the names and the groups of the parameters.
#include "host/scene/splat_model.hpp"

#include <algorithm>

#include "host/base/error.hpp"

namespace ubs {

ParameterLayout::ParameterLayout(int dim_, const ModelVariant& variant_)
    : dim(dim_), query(dim_ - 3), variant(variant_) {
  if (dim < kMinDim || dim > kMaxDim)
    fail(ErrorKind::usage, "dimension N = {} is not supported: choose {} to {}", dim, kMinDim, kMaxDim);
  check_variant(dim, variant);
  opacity = rgb + 3 * std::max(variant.harmonics(), 1) + 6 * variant.lobes();
  beta = opacity + 1;
  query_beta = beta + (variant.has_spatial_beta() ? 1 : 0);
  mean = query_beta + (variant.has_query_beta() ? query : 0);
  scale = mean + query;
  l_triangle = scale + dim;
  count = l_triangle + (variant.rot_mode == RotMode::quaternion ? 4 : dim * (dim - 1) / 2);
}

std::vector<std::string> ParameterLayout::property_names() const {
  std::vector<std::string> names{"x", "y", "z"};
  const auto numbered = [&names](const char* stem, int first, int n) {
    for (int i = first; i < first + n; ++i) names.push_back(fmt::format("{}_{}", stem, i));
  };
  if (variant.harmonics()) {
    numbered("f_dc", 0, 3);
    numbered("f_rest", 0, 3 * variant.harmonics() - 3);
    numbered("sb_params", 0, 6 * variant.lobes());
  } else {
    names.insert(names.end(), {"red", "green", "blue"});
  }
  names.push_back("opacity");
  numbered("beta", 0, query_beta - beta);
  // The numbers of query dimensions start at 1, even if there is no spatial beta, which would be beta_0.
  numbered(variant.learnt_weights() ? "lambda" : "beta", 1, mean - query_beta);
  numbered("mean", 0, query);
  if (variant.direct() && query > 0) {
    // The diagonal entry of row i of the precision factor is stored in the row of a query scale. The other
    // entries of row i are stored after Theta_i, the three entries that move the mean.
    const auto packed = [](int i, int j) { return i * (i + 1) / 2 + j; };
    numbered("scale", 0, 3);
    for (int i = 0; i < query; ++i) numbered("precision", packed(i, i), 1);
    numbered("l_triangle", 0, 3);
    for (int i = 0; i < query; ++i) {
      numbered("theta", 3 * i, 3);
      numbered("precision", packed(i, 0), i);
    }
    return names;
  }
  numbered("scale", 0, dim);
  numbered(variant.rot_mode == RotMode::quaternion ? "rot" : "l_triangle", 0, count - l_triangle);
  return names;
}

std::vector<ParameterGroup> parameter_groups(const ParameterLayout& l) {
  const int rows[] = {l.xyz, l.rgb, l.rgb + 3, l.opacity, l.beta, l.mean, l.scale, l.l_triangle, l.count};
  const bool harmonics = l.variant.harmonics() > 0, lobes = l.variant.lobes() > 0;
  const std::string_view rotation = l.variant.rot_mode == RotMode::quaternion ? "rotation" : "l_triangle";
  std::vector<ParameterGroup> groups;
  for (const auto& [name, number] : kParameterGroups) {
    const bool has = number == 1   ? name == (harmonics ? "sh0" : "rgb")
                     : number == 2 ? harmonics && name == (lobes ? "lobes" : "sh_rest")
                     : number == 7 ? name == rotation
                                   : true;
    if (has) groups.push_back({std::string(name), rows[number], rows[number + 1] - rows[number]});
  }
  return groups;
}

SplatModel::SplatModel(int dim_, std::size_t count_, const ModelVariant& variant_)
    : dim(dim_), variant(variant_), count(count_) {
  values.assign(static_cast<std::size_t>(layout().count) * count, 0.0f);
}

}  // namespace ubs
