// SPDX-License-Identifier: Apache-2.0
// The steps of the oracle one by one, so that a stage of the product can be compared on inputs that are
// exact: footprints -> frame -> image -> gradient of the image -> of the footprints -> of the raw parameters
// of a splat.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "host/lab/oracle/frame.hpp"
#include "host/lab/oracle/oracle.hpp"
#include "host/lab/oracle/splat_formula.hpp"

namespace ubs::oracle {

inline constexpr int kFootprintInputs = 11;  // mean 2, conic 3, opacity, beta, rgb 3, depth
using FootprintGradient = std::array<double, kFootprintInputs>;

Render render_frame(const Frame& frame, const Camera& camera, const Options& options);
// oracle::loss of an image, and d loss / d image; image and target are (3, height, width).
double image_loss(std::span<const double> image, std::span<const double> target, int width, int height,
                  LossWeights weights);
std::vector<double> image_gradient(std::span<const double> image, std::span<const double> target, int width,
                                   int height, LossWeights weights);
// By position in Frame::splats, given d loss / d image, and d loss / d depth of pixels with alpha > 1e-6;
// either may be empty.
std::vector<FootprintGradient> footprint_gradients(const Frame& frame, const Camera& camera,
                                                   const Options& options, std::span<const double> v_image,
                                                   std::span<const double> v_depth = {});
// d loss / d raw parameters of one splat, given that of its footprint.
std::vector<double> parameter_gradient(const std::vector<double>& raw, const Rows& rows, const Camera& camera,
                                       const Options& options, const FootprintGradient& g, Tape& tape);
// In the layout of Model::values, given those of footprint_gradients().
std::vector<double> parameter_gradients(const Frame& frame, const Model& model, const Camera& camera,
                                        const Options& options,
                                        std::span<const FootprintGradient> footprints);

// By how much the parts of the gradient of sum(weights * image) that reach the parameters through the mean,
// through the ellipse and through the rest of the footprints cancel: the 2-norm of the sums of their sizes
// over that of the gradient, of the parameter group where it is largest. 1: they do not.
double gradient_cancellation(const Frame& frame, const Model& model, const Camera& camera,
                             const Options& options, std::span<const double> weights);

}  // namespace ubs::oracle
