// SPDX-License-Identifier: Apache-2.0
// What a single-precision program can be held to: the oracle's image and gradient, the pixels at which
// rounding decides (a splat within rounding of its rim, of the stop, of the cap, of another splat's depth),
// and how far both move when every input moves by half a unit of its last place, which no single-precision
// program can be asked to stay below.
#pragma once

#include <cstdint>
#include <vector>

#include "host/lab/oracle/oracle.hpp"

namespace ubs::oracle {

struct StudyOptions {
  // A decision counts as undecided within this many times the change that rounding of the inputs makes, taken
  // as independent. 0: every pixel is decided, for scenes whose thresholds are met exactly.
  double margin = 32;
  int neighbours = 2;      // perturbed evaluations
  std::uint64_t seed = 1;  // of the perturbations
  bool gradient = true;
};

struct Neighbour {
  std::vector<double> image, gradient;
};

struct Study {
  Render image;
  std::vector<double> gradient;         // of sum(weights * image) over the decided pixels
  std::vector<std::uint8_t> undecided;  // per pixel
  std::size_t undecided_pixels = 0;
  std::vector<Neighbour> neighbours;  // the same weights
  std::size_t drawn = 0;              // visible splats
  std::size_t undecided_splats = 0;   // at a cull, or beyond single precision
  std::size_t floored = 0;            // drawn with a lifted pivot: the derivative is not defined
  std::vector<std::uint8_t> culled;   // per splat: without doubt not drawn
  // Of the drawn splats, for classification.
  double amplification = 1;          // of rounding in the conic (Footprint)
  double gradient_cancellation = 1;  // of the ways to the parameters (oracle_stages.hpp); of up to 64 splats
  double colour_contrast = 1;  // largest colour or background over the smallest size of a splat's colour
};

// weights are (3, H, W).
Study study(const Model& model, const Camera& camera, const std::vector<double>& weights,
            const Options& options, const StudyOptions& how);

}  // namespace ubs::oracle
