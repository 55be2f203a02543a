// SPDX-License-Identifier: Apache-2.0
// A set of N-dimensional Beta splats as RAW parameters (before sigmoid, softplus, exp; method.md 1.1).
// Storage is structure-of-arrays in the order of the published file (method.md 5.1): one row per
// property, `count` values per row. The device keeps the same rows with a padded stride.
#pragma once

#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/scene/model_variant.hpp"

namespace ubs {

// Of raw opacities; exact to the last bits on both sides of 0.
inline double sigmoid(double x) { return x < 0 ? std::exp(x) / (1 + std::exp(x)) : 1 / (1 + std::exp(-x)); }

inline constexpr int kMinDim = 3;
inline constexpr int kMaxDim = 11;  // 3 spatial + at most 8 query dimensions

// Whether time is among the query dimensions (kernels/layout.h): N = 4, 5 and from 7 on.
constexpr bool has_time(int dim) { return dim == 4 || dim == 5 || dim >= 7; }

// Row numbers of the parameter groups of an N-dimensional splat; C = N - 3 query dimensions. The same
// arithmetic as kernels/layout.h (tests/math/splat_vjp_test.cpp compares them).
struct ParameterLayout {
  explicit ParameterLayout(int dim, const ModelVariant& variant = {});
  int dim, query;  // N, C
  ModelVariant variant;
  int xyz = 0,
      rgb = 3;  // or, in the place of rgb, spherical harmonics: constant terms, then the others or lobes
  int opacity, beta, query_beta;  // `beta` is the spatial one; either group may have no rows
  int mean, scale, l_triangle;    // or, in the place of l_triangle, the quaternion
  int count;                      // N(N+1)/2 + 2N + 2 by default
  std::vector<std::string> property_names() const;  // PLY names, in row order
};

// All that there are, by their numbers in kernels/layout.h (UBS_GROUPS); those of one number exclude one
// another.
struct GroupName {
  std::string_view name;
  int number;
};
inline constexpr GroupName kParameterGroups[] = {
    {"xyz", 0},  {"rgb", 1},  {"sh0", 1},   {"sh_rest", 2},    {"lobes", 2},   {"opacity", 3},
    {"beta", 4}, {"mean", 5}, {"scale", 6}, {"l_triangle", 7}, {"rotation", 7}};

struct ParameterGroup {
  std::string name;
  int first, count;  // rows
};
// In row order; groups without rows have count 0.
std::vector<ParameterGroup> parameter_groups(const ParameterLayout& layout);

struct SplatModel {
  int dim = 6;
  ModelVariant variant;
  std::size_t count = 0;
  std::vector<float> values;  // (parameter count) x count, row-major

  SplatModel() = default;
  SplatModel(int dim, std::size_t count, const ModelVariant& variant = {});
  ParameterLayout layout() const { return ParameterLayout(dim, variant); }
  std::span<float> row(int r) { return {values.data() + static_cast<std::size_t>(r) * count, count}; }
  std::span<const float> row(int r) const {
    return {values.data() + static_cast<std::size_t>(r) * count, count};
  }
};

}  // namespace ubs
