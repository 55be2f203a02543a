// SPDX-License-Identifier: Apache-2.0
// Row arithmetic of the parameter table; see splat_model.hpp.
#include "host/scene/splat_model.hpp"

#include "host/base/error.hpp"

namespace ubs {

ParameterLayout::ParameterLayout(int dim_) : dim(dim_), query(dim_ - 3) {
  if (dim < kMinDim || dim > kMaxDim)
    fail(ErrorKind::usage, "dimension N = {} is not supported: choose {} to {}", dim, kMinDim, kMaxDim);
  mean = beta + 1 + query;
  scale = mean + query;
  l_triangle = scale + dim;
  count = l_triangle + dim * (dim - 1) / 2;
}

std::vector<std::string> ParameterLayout::property_names() const {
  std::vector<std::string> names{"x", "y", "z", "red", "green", "blue", "opacity"};
  const auto numbered = [&names](const char* stem, int n) {
    for (int i = 0; i < n; ++i) names.push_back(fmt::format("{}_{}", stem, i));
  };
  numbered("beta", 1 + query);
  numbered("mean", query);
  numbered("scale", dim);
  numbered("l_triangle", dim * (dim - 1) / 2);
  return names;
}

std::vector<ParameterGroup> parameter_groups(const ParameterLayout& l) {
  return {{"xyz", l.xyz, 3},
          {"rgb", l.rgb, 3},
          {"opacity", l.opacity, 1},
          {"beta", l.beta, 1 + l.query},
          {"mean", l.mean, l.query},
          {"scale", l.scale, l.dim},
          {"l_triangle", l.l_triangle, l.count - l.l_triangle}};
}

SplatModel::SplatModel(int dim_, std::size_t count_) : dim(dim_), count(count_) {
  values.assign(static_cast<std::size_t>(layout().count) * count, 0.0f);
}

}  // namespace ubs
