// SPDX-License-Identifier: Apache-2.0
// study() determines what can be required of a single-precision program. The result contains the image and
// the gradient of the oracle. It marks the undecided pixels. At an undecided pixel, a splat is so close to a
// threshold that a rounding error may put it on either side. The thresholds are the rim of the splat, the
// stop, the cap and the depth of another splat. The result also contains images and gradients for inputs that
// are changed by half a unit in their last place. No single-precision program can be required to have smaller
// errors than this change causes.
#pragma once

#include <cstdint>
#include <vector>

#include "host/lab/oracle/oracle.hpp"

namespace ubs::oracle {

struct StudyOptions {
  // A decision counts as undecided if its distance from the threshold is less than this multiple of the
  // change that rounding of the inputs causes. The roundings are assumed to be independent. 0: every pixel
  // counts as decided; this is for scenes that meet the thresholds exactly.
  double margin = 32;
  int neighbours = 2;      // number of perturbed evaluations
  std::uint64_t seed = 1;  // seed of the perturbations
  bool gradient = true;
};

struct Neighbour {
  std::vector<double> image, gradient;
};

struct Study {
  Render image;
  std::vector<double> gradient;         // gradient of sum(weights * image) over the decided pixels
  std::vector<std::uint8_t> undecided;  // per pixel
  std::size_t undecided_pixels = 0;
  std::vector<Neighbour> neighbours;  // with the same weights
  std::size_t drawn = 0;              // number of visible splats
  // Splats within rounding of a cull, or outside the range of single precision.
  std::size_t undecided_splats = 0;
  std::size_t floored = 0;           // visible splats with a raised pivot, whose derivative is not defined
  std::vector<std::uint8_t> culled;  // per splat: 1 if it is certainly not visible
  // Properties of the visible splats, for classification.
  double amplification = 1;  // amplification of rounding in the conic (Footprint)
  // gradient_cancellation() of oracle_stages.hpp; only computed for up to 64 splats.
  double gradient_cancellation = 1;
  double colour_contrast = 1;  // largest colour or background / smallest magnitude of a splat's colour
};

// `weights` are (3, H, W).
Study study(const Model& model, const Camera& camera, const std::vector<double>& weights,
            const Options& options, const StudyOptions& how);

}  // namespace ubs::oracle
