// SPDX-License-Identifier: Apache-2.0
// The steps of the oracle one by one, so that a stage of the product can be compared on inputs that are
// exact: footprints -> frame -> image -> gradient of the image -> of the footprints -> of the raw parameters
// of a splat.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "tests/reference/oracle.hpp"
#include "tests/reference/splat_formula.hpp"

namespace ubs::oracle {

inline constexpr int kFootprintInputs = 10;  // mean 2, conic 3, opacity, beta, rgb 3
using FootprintGradient = std::array<double, kFootprintInputs>;

struct Frame {
  std::vector<std::size_t> splats;            // model index of each visible splat, front to back
  std::vector<Footprint<double>> footprints;  // in the same order
  std::vector<std::vector<int>> lists;        // per pixel: positions in `splats` of the composited ones
};

std::vector<double> splat_parameters(const Model& model, const Rows& rows, std::size_t splat);
// One footprint a splat of the model; those that are culled have `visible` false.
std::vector<Footprint<double>> project(const Model& model, const Camera& camera, const Options& options);
// Front to back by the depth as a float, ties by index, so that equal keys agree with a float sort.
Frame make_frame(const std::vector<Footprint<double>>& footprints, const Camera& camera,
                 const Options& options);
Render render_frame(const Frame& frame, const Camera& camera, const Options& options);
// d loss / d image; image and target are (3, height, width).
std::vector<double> image_gradient(std::span<const double> image, std::span<const double> target, int width,
                                   int height, double lambda_dssim);
// By position in Frame::splats, given d loss / d image.
std::vector<FootprintGradient> footprint_gradients(const Frame& frame, const Camera& camera,
                                                   const Options& options,
                                                   const std::vector<double>& v_image);
// d loss / d raw parameters of one splat, given that of its footprint.
std::vector<double> parameter_gradient(const std::vector<double>& raw, const Rows& rows, const Camera& camera,
                                       const Options& options, const FootprintGradient& g, Tape& tape);

}  // namespace ubs::oracle
