// SPDX-License-Identifier: Apache-2.0
// This file declares the single steps of the oracle, so that one stage of the pipeline can be compared with
// the oracle on exact inputs. The steps are footprints -> frame -> image -> gradient of the image -> gradient
// of the footprints -> gradient of the raw parameters of a splat.
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
// image_loss() returns the loss of an image (the loss of oracle::loss()), and image_gradient() returns d loss
// / d image. `image` and `target` have the shape (3, height, width).
double image_loss(std::span<const double> image, std::span<const double> target, int width, int height,
                  LossWeights weights);
std::vector<double> image_gradient(std::span<const double> image, std::span<const double> target, int width,
                                   int height, LossWeights weights);
// Returns the gradients of the footprints in the order of Frame::splats. `v_image` is d loss / d image, and
// `v_depth` is d loss / d depth, which is used only in pixels with alpha > 1e-6. One of them may be empty.
std::vector<FootprintGradient> footprint_gradients(const Frame& frame, const Camera& camera,
                                                   const Options& options, std::span<const double> v_image,
                                                   std::span<const double> v_depth = {});
// Returns d loss / d raw parameters of one splat. `g` is the gradient of its footprint.
std::vector<double> parameter_gradient(const std::vector<double>& raw, const Rows& rows, const Camera& camera,
                                       const Options& options, const FootprintGradient& g, Tape& tape);
// Returns the gradients of all raw parameters in the layout of Model::values. `footprints` is the result of
// footprint_gradients().
std::vector<double> parameter_gradients(const Frame& frame, const Model& model, const Camera& camera,
                                        const Options& options,
                                        std::span<const FootprintGradient> footprints);

// Returns how strongly the parts of the gradient of sum(weights * image) cancel. The parts reach the
// parameters through the mean, through the ellipse, and through the rest of the footprints. The measure is
// the 2-norm of the sums of their magnitudes, divided by the 2-norm of the gradient, for the parameter group
// for which this ratio is largest. The result 1 means that there is no cancellation.
double gradient_cancellation(const Frame& frame, const Model& model, const Camera& camera,
                             const Options& options, std::span<const double> weights);

}  // namespace ubs::oracle
