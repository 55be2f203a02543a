// SPDX-License-Identifier: Apache-2.0
// SplatForm is the interface to one form of the mathematics of a splat (kernels/math/splat.h). A form is a
// variant with one N and one set of gradients. The types of the interface do not depend on the form, so
// splat_form.cpp is compiled once for each form, and the tests in splat_vjp_test.cpp only once.
#pragma once

#include <array>
#include <vector>

#include "tests/math/shared_math.hpp"

namespace ubs::test {

// Raw parameters by rows, or gradients with respect to them at the same indices, or gradients with respect to
// the camera.
using SplatValues = std::array<double, 128>;

// Intermediate values. Forms without the coupled factor only set `scale`, `lifted` and `coupled`.
struct SplatInside {
  double scale[11];
  bool lifted, coupled;           // of splat_thin
  bool from_factor;               // of splat_state
  double x[8], b[8][11];          // of the slice's input
  double frame[3][3], sum[3][3];  // the frame, and K as a sum
  double m[3][3], shrink[3][3];   // used for rendering instead of `frame` and `sum`
};

struct SplatForm {
  const char* name;
  int n;
  std::array<int, 9> variant;  // in the order of ubs::kVariantSwitches
  bool query_grad, camera_grad, depth_grad;
  std::array<int, 9> rows;  // xyz, rgb, opacity, beta, query_beta, mean, scale, l_triangle, count
  int harmonics;
  double query_scale_least, scale_least;
  SplatImage (*image)(const CameraView&, const SplatValues&);
  SplatValues (*gradient)(const CameraView&, const SplatValues&, const SplatImageVjp&);
  SplatInside (*inside)(const CameraView&, const SplatValues&);
};

// Returns all linked forms.
inline std::vector<const SplatForm*>& splat_forms() {
  static std::vector<const SplatForm*> forms;
  return forms;
}

}  // namespace ubs::test
