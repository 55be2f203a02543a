// SPDX-License-Identifier: Apache-2.0
// SplatForm is the interface to one form of the mathematics of a splat (kernels/math/splat.h). A form is a
// combination of a variant, a number of dimensions N, and a kind of gradient. There are three kinds:
// gradients of the parameters without the path through the view direction, gradients of the parameters with
// this path, and gradients of the camera. splat_form.cpp is compiled once for each form. The types of the
// interface do not depend on the form, so the tests in splat_vjp_test.cpp are compiled only once.
#pragma once

#include <array>
#include <vector>

#include "tests/math/shared_math.hpp"

namespace ubs::test {

// SplatValues contains the raw parameters of a splat in the order of their rows, the gradients of these
// parameters in the same order, or the gradient of the camera.
using SplatValues = std::array<double, 128>;

// Intermediate values of a splat. Forms without UBS_COUPLED_FACTOR (kernels/math/conditional.h) set only
// `scale`, `lifted` and `coupled`.
struct SplatInside {
  double scale[11];               // the scales of the frame
  bool lifted, coupled;           // result of splat_thin()
  bool from_factor;               // SplatState::coupled: K was computed from its factor
  double x[8], b[8][11];          // members of SliceInput
  double frame[3][3], sum[3][3];  // the frame M, and K computed as I - U^T Y
  double m[3][3], shrink[3][3];   // the matrices that are used for rendering: M and K, or M W^T and K'
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

// Returns all forms that are linked into the test program.
inline std::vector<const SplatForm*>& splat_forms() {
  static std::vector<const SplatForm*> forms;
  return forms;
}

}  // namespace ubs::test
