// SPDX-License-Identifier: Apache-2.0
// Case is one question of a stress run: a model seen by a camera, and weights of the pixels. The image is
// compared and the gradient of sum(weights * image), so that nothing but the renderer is involved. The
// functions below build the plain scene that rows vary: a camera at the origin that looks along z, and splats
// in front of it.
#pragma once

#include <string>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::stress {

struct Case {
  std::string name;
  std::uint64_t seed = 0;  // of the weights
  SplatModel model;
  Camera camera;
  RenderSettings settings;
  bool query_grad = false;
  bool exact = false;  // thresholds are met exactly in single precision: no pixel is left out
};

// Returns the weights of the case's pixels, (3, H, W), between -1 and 1.
std::vector<float> pixel_weights(const Case& c);

inline constexpr int kRowDims[] = {3, 4, 5, 6, 7};

// Returns a case with 32 x 24 pixels, fx = fy = 32, the principal point in the middle, and time 0.5. All
// numbers are exact in single precision, and so are projections of points at depths that are powers of two.
Case row_case(const std::string& name, int dim, std::size_t splats, const ModelVariant& variant = {});

// SplatPlan holds everything about splat i of a row_case, in activated values. The defaults make an ordinary
// splat that differs a little from the others, in the middle of the image at depth 2, seen from where it
// expects.
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

// Returns a case of `count` ordinary splats spread over the image.
Case ordinary_case(const std::string& name, int dim, std::size_t count, std::uint64_t seed = 1);

}  // namespace ubs::stress
