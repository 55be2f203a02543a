// SPDX-License-Identifier: Apache-2.0
// SplatModel is a set of N-dimensional Beta splats with raw parameters. Raw parameters are the values that
// are trained, before functions such as sigmoid, softplus and exp are applied to them (method.md 1.1). There
// is one row per parameter, with `count` values per row. The rows have the order of the published file format
// (method.md 5.1). Device memory contains the same rows with a padded stride.
#pragma once

#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/scene/model_variant.hpp"

namespace ubs {

// Converts a raw opacity to an opacity from 0 to 1. The result is accurate for large positive and negative x.
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
  // With spherical harmonics, `rgb` is the first row of the coefficients of the constant terms. They are
  // followed by the other coefficients, or by the parameters of the lobes.
  int xyz = 0, rgb = 3;
  int opacity, beta, query_beta;  // `beta` is the spatial beta; `beta` and `query_beta` may have no rows
  int mean, scale, l_triangle;    // with rot_mode = quaternion, `l_triangle` is the quaternion
  int count;                      // number of rows: N(N+1)/2 + 2N + 2 for the published variant
  // Returns the names of the properties in PLY files, in the order of the rows.
  std::vector<std::string> property_names() const;
};

// GroupName is the name of a parameter group and its number in kernels/layout.h (UBS_GROUPS).
// kParameterGroups contains all groups. Some of them have the same number; a model has at most one of these.
struct GroupName {
  std::string_view name;
  int number;
};
inline constexpr GroupName kParameterGroups[] = {
    {"xyz", 0},  {"rgb", 1},  {"sh0", 1},   {"sh_rest", 2},    {"lobes", 2},   {"opacity", 3},
    {"beta", 4}, {"mean", 5}, {"scale", 6}, {"l_triangle", 7}, {"rotation", 7}};

struct ParameterGroup {
  std::string name;
  int first, count;  // first row, and number of rows
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
