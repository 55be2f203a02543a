// SPDX-License-Identifier: Apache-2.0
// The plain scene that rows vary: a camera at the origin that looks along z, and splats in front of it.
#pragma once

#include "host/stress/case.hpp"

namespace ubs::stress {

inline constexpr int kRowDims[] = {3, 4, 5, 6, 7};

// 32 x 24 pixels, fx = fy = 32, principal point in the middle, time 0.5. All numbers are exact in single
// precision, and so are projections of points at depths that are powers of two.
Case row_case(const std::string& name, int dim, std::size_t splats, const ModelVariant& variant = {});

// Everything about splat i of a row_case, in activated values; unset: ordinary ones that differ a little from
// splat to splat, in the middle of the image at depth 2, seen from where it expects.
struct SplatPlan {
  std::array<double, 3> position{0, 0, 2};
  std::array<double, 3> scale{0.4, 0.5, 0.3};
  double opacity_raw = 1;
  double beta_raw = 0, query_beta_raw = 0;
  double query_scale = 1;
  double coupling = 0.3;      // entries of l_triangle below the spatial block
  double omega = 0.3;         // of the spatial rotation
  double query_offset = 0.2;  // mean - query
};
void put_splat(Case& c, std::size_t i, const SplatPlan& plan);

// A case of `count` ordinary splats spread over the image.
Case ordinary_case(const std::string& name, int dim, std::size_t count, std::uint64_t seed = 1);

double raw_scale(double scale);  // inverse of softplus

}  // namespace ubs::stress
