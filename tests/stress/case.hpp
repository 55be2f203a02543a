// SPDX-License-Identifier: Apache-2.0
// Case describes what a stress test renders and compares: a model, a camera, and weights for the pixels. The
// image and the gradient of sum(weights * image) are compared, so that only the renderer is tested, and not
// the loss. The functions below create a simple scene, which the stress tests change: a camera at the origin
// that looks along z, and splats in front of it.
#pragma once

#include <string>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::stress {

struct Case {
  std::string name;
  std::uint64_t seed = 0;  // seed of the weights
  SplatModel model;
  Camera camera;
  RenderSettings settings;
  bool query_grad = false;
  // True if all values that are compared with thresholds are exact in single precision. Then rounding cannot
  // change which side of a threshold a value is on, and all pixels are compared.
  bool exact = false;
};

// Returns the weights of the pixels of the case, (3, H, W), between -1 and 1.
std::vector<float> pixel_weights(const Case& c);

// Dimensions of the models in most stress tests.
inline constexpr int kRowDims[] = {3, 4, 5, 6, 7};

// Returns a case with 32 x 24 pixels, fx = fy = 32, the principal point in the centre, and time 0.5. All
// numbers of the camera are exact in single precision, and so are the projections of points whose depths are
// powers of two.
Case row_case(const std::string& name, int dim, std::size_t splats, const ModelVariant& variant = {});

// SplatPlan holds the properties of a splat of a row_case, except its colours. Members whose names end in
// _raw are raw parameters. The scales are values after activation. The defaults describe an ordinary splat in
// the centre of the image at depth 2, whose query mean is close to the query.
struct SplatPlan {
  std::array<double, 3> position{0, 0, 2};
  std::array<double, 3> scale{0.4, 0.5, 0.3};
  double opacity_raw = 1;
  double beta_raw = 0, query_beta_raw = 0;
  double query_scale = 1;
  double coupling = 0.3;      // largest magnitude of the entries of l_triangle below the spatial block
  double omega = 0.3;         // largest magnitude of the entries of the spatial rotation
  double query_offset = 0.2;  // largest difference between the mean of the splat and the query
};
// Writes the raw parameters of splat i. Its colours, the entries of l_triangle and the offsets of its query
// mean are random within the limits of `plan`. The random numbers depend only on i.
void put_splat(Case& c, std::size_t i, const SplatPlan& plan);

// Returns a case of `count` ordinary splats that are spread over the image.
Case ordinary_case(const std::string& name, int dim, std::size_t count, std::uint64_t seed = 1);

}  // namespace ubs::stress
