// SPDX-License-Identifier: Apache-2.0
// SplatModel is a set of N-dimensional Beta splats with RAW parameters (before sigmoid, softplus, exp;
// method.md 1.1). It is stored as a structure of arrays in the order of the published file (method.md 5.1):
// one row per property, with `count` values per row. The device has the same rows with a padded stride.
#pragma once

#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/scene/model_variant.hpp"

namespace ubs {

// Converts a raw opacity. Accurate to the last bits on both sides of 0.
inline double sigmoid(double x) { return x < 0 ? std::exp(x) / (1 + std::exp(x)) : 1 / (1 + std::exp(-x)); }

inline constexpr int kMinDim = 3;
inline constexpr int kMaxDim = 11;  // 3 spatial + at most 8 query dimensions

// Returns whether time is one of the query dimensions (kernels/layout.h): N = 4, N = 5 and N >= 7.
constexpr bool has_time(int dim) { return dim == 4 || dim == 5 || dim >= 7; }

// ParameterLayout holds the first row of each parameter group of an N-dimensional splat, with C = N - 3 query
// dimensions. The arithmetic is the same as in kernels/layout.h (tests/math/splat_vjp_test.cpp compares
// them).
struct ParameterLayout {
  explicit ParameterLayout(int dim, const ModelVariant& variant = {});
  int dim, query;  // N, C
  ModelVariant variant;
  // With spherical harmonics, `rgb` is the first row of the constant terms. The other harmonics, or the
  // lobes, follow after them.
  int xyz = 0, rgb = 3;
  int opacity, beta, query_beta;                    // `beta` is the spatial beta; both groups may be empty
  int mean, scale, l_triangle;                      // `l_triangle` is the quaternion with rot_mode quaternion
  int count;                                        // N(N+1)/2 + 2N + 2 by default
  std::vector<std::string> property_names() const;  // PLY names, in row order
};

// All parameter groups with their numbers in kernels/layout.h (UBS_GROUPS). A model has at most one of the
// groups with the same number.
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
// Returns the groups of a layout in the order of their rows. Groups without rows have count 0.
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
