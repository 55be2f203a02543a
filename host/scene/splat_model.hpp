// SPDX-License-Identifier: Apache-2.0
// A set of N-dimensional Beta splats as RAW parameters (before sigmoid, softplus, exp; method.md 1.1).
// Storage is structure-of-arrays in the order of the published file (method.md 5.1): one row per
// property, `count` values per row. The device keeps the same rows with a padded stride.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace ubs {

inline constexpr int kMinDim = 3;
inline constexpr int kMaxDim = 11;  // 3 spatial + at most 8 query dimensions

// Whether time is among the query dimensions (kernels/layout.h): N = 4, 5 and from 7 on.
constexpr bool has_time(int dim) { return dim == 4 || dim == 5 || dim >= 7; }

// Row numbers of the parameter groups of an N-dimensional splat; C = N - 3 query dimensions.
struct ParameterLayout {
  explicit ParameterLayout(int dim);
  int dim, query;  // N, C
  int xyz = 0, rgb = 3, opacity = 6, beta = 7, mean, scale, l_triangle;
  int count;                                        // N(N+1)/2 + 2N + 2
  std::vector<std::string> property_names() const;  // PLY names, in row order
};

struct ParameterGroup {
  std::string name;  // xyz, rgb, opacity, beta, mean, scale, l_triangle
  int first, count;  // rows
};
std::vector<ParameterGroup> parameter_groups(const ParameterLayout& layout);

struct SplatModel {
  int dim = 6;
  std::size_t count = 0;
  std::vector<float> values;  // (parameter count) x count, row-major

  SplatModel() = default;
  SplatModel(int dim, std::size_t count);
  ParameterLayout layout() const { return ParameterLayout(dim); }
  std::span<float> row(int r) { return {values.data() + static_cast<std::size_t>(r) * count, count}; }
  std::span<const float> row(int r) const {
    return {values.data() + static_cast<std::size_t>(r) * count, count};
  }
};

}  // namespace ubs
