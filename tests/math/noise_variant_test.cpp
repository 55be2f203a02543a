// SPDX-License-Identifier: Apache-2.0
// Tests the noise of kernels/math/mcmc.h for the variants of the covariance. This file is compiled once for
// each of them. The displacement must be Sigma_x times a vector of normal numbers. Sigma_x is the leading 3 x
// 3 block of L L^T; the test computes the rows of L that are needed for it.
// clang-format off: mcmc.h needs this header before it
#include "tests/math/shared_math.hpp"
// clang-format on
#include <catch2/catch.hpp>

#include "kernels/math/mcmc.h"

#define UBS_STRING2(x) #x
#define UBS_STRING(x) UBS_STRING2(x)

TEST_CASE("the displacement by noise is Sigma_x times normal numbers, " UBS_STRING(UBS_TEST_VARIANT),
          "[mcmc][variants]") {
  FrameRaw raw;
  double scale[UBS_N], spatial[3][UBS_N] = {};
  for (int c = 0; c < UBS_F; ++c) {
    raw.scale[c] = 0.3 * c - 1;
    scale[c] = std::log1p(std::exp(raw.scale[c]));
  }
  for (int m = 0; m < kFrameRots; ++m) raw.rotation[m] = 0.2 + 0.1 * m;
#if UBS_COV_PARAM == UBS_COV_CHOLESKY
  for (int r = 0; r < 3; ++r) {
    spatial[r][r] = scale[r];
    for (int c = 0; c < r; ++c) spatial[r][c] = raw.rotation[r * (r - 1) / 2 + c];
  }
#elif UBS_COV_PARAM == UBS_COV_SKEW_ND
  // The entries have the same order as in a model file: (1,0), (2,0), (2,1), and then (i,0), (i,1), (i,2) for
  // each query row i.
  for (int r = 0; r < 3; ++r) spatial[r][r] = scale[r];
  const int pairs[3][2] = {{0, 1}, {0, 2}, {1, 2}};
  for (int m = 0; m < 3; ++m) {
    spatial[pairs[m][0]][pairs[m][1]] = raw.rotation[m] * scale[pairs[m][1]];
    spatial[pairs[m][1]][pairs[m][0]] = -raw.rotation[m] * scale[pairs[m][0]];
  }
  for (int i = 3; i < UBS_N; ++i)
    for (int r = 0; r < 3; ++r) spatial[r][i] = raw.rotation[3 * (i - 2) + r] * scale[i];
#else
  const Mat3 rotation = rotation_matrix(frame_rotation(raw));
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) spatial[r][c] = rotation.e[r][c] * scale[c];
#endif
  const double normals[3] = {0.5, -1.2, 0.8}, opacity = -4.5;
  const Vec3 d =
      noise_displacement(spatial_frame(raw), opacity, {{normals[0], normals[1], normals[2]}}, 0.02);
  const double o = 1 / (1 + std::exp(-opacity));
  const double gate = std::pow(1 - o, 100);
  for (int r = 0; r < 3; ++r) {
    double expected = 0;
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < UBS_N; ++k) expected += spatial[r][k] * spatial[c][k] * normals[c];
    CHECK(d.e[r] == Approx(expected * gate * 0.02).epsilon(1e-12));
  }
}
