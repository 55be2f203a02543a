// SPDX-License-Identifier: Apache-2.0
// study() determines which accuracy can be required of a single-precision program. The result contains the
// image and the gradient of the oracle. It marks the undecided pixels. At an undecided pixel, a splat is so
// close to a threshold that a rounding error may put it on either side. The pixel has four thresholds: the
// rim of the support, the transmittance at which compositing stops, the maximum alpha, and the depth of
// another splat, which decides the order of the two. All pixels that a splat may reach are undecided too if
// rounding decides whether the splat is culled, if one of its formulas is near a kink, or if its values may
// exceed the range of single precision. The result also contains images and gradients for inputs that are
// changed at random by about half a unit in the last place of single precision. A single-precision program
// cannot be required to have smaller errors than these changes cause.
#pragma once

#include <cstdint>
#include <vector>

#include "host/lab/oracle/oracle.hpp"

namespace ubs::oracle {

struct StudyOptions {
  // A decision counts as undecided if its distance from the threshold is less than this multiple of the
  // change that rounding of the inputs causes. The rounding errors of the inputs are assumed to be
  // independent. With 0, every pixel counts as decided; this is for scenes in which values equal the
  // thresholds exactly.
  double margin = 32;
  int neighbours = 2;      // number of evaluations with changed inputs
  std::uint64_t seed = 1;  // seed of the random changes of the inputs
  bool gradient = true;    // also compute gradients
};

// Neighbour contains the results for changed inputs.
struct Neighbour {
  std::vector<double> image, gradient;
};

struct Study {
  Render image;
  std::vector<double> gradient;         // gradient of sum(weights * image) over the decided pixels
  std::vector<std::uint8_t> undecided;  // one per pixel; 1: undecided
  std::size_t undecided_pixels = 0;
  std::vector<Neighbour> neighbours;  // computed with the same weights as `gradient`
  std::size_t drawn = 0;              // number of visible splats
  // Number of splats that rounding may cull or make visible. It includes splats that are near a kink of a
  // formula, and splats whose values may exceed the range of single precision.
  std::size_t undecided_splats = 0;
  // Number of visible splats with a raised pivot, whose derivative is undefined.
  std::size_t floored = 0;
  std::vector<std::uint8_t> culled;  // per splat: 1 if it is certainly not visible
  // The following properties of the visible splats are used to classify scenes.
  double amplification = 1;  // maximum of Footprint::amplification
  // gradient_cancellation() of oracle_stages.hpp; only computed for up to 64 splats.
  double gradient_cancellation = 1;
  // Largest magnitude of a splat's colour or of a background channel, divided by the smallest magnitude of a
  // splat's colour, and at least 1. It stays 1 if a splat is black.
  double colour_contrast = 1;
};

// Studies one view. The gradient is that of sum(weights * image); `weights` have the shape (3, H, W).
Study study(const Model& model, const Camera& camera, const std::vector<double>& weights,
            const Options& options, const StudyOptions& how);

}  // namespace ubs::oracle
