// SPDX-License-Identifier: Apache-2.0
// compute_truth() computes one view of a model, its loss and its gradient in float64. compute_stage_truth()
// does the same stage by stage, where the input of each stage is the exact result of the previous stages
// rounded to float32. Both use the oracle of host/lab/oracle, which shares no code with the kernels and
// computes derivatives automatically with a tape.
#pragma once

#include <vector>

#include "host/check/stage_truth.hpp"
#include "host/lab/oracle/oracle.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::accuracy {

using check::Problem;
using check::StageTruth;

// Returns the values of the 8-bit image divided by 255, as three planes (red, green, blue).
std::vector<float> planar_target(const Image8& image);

struct Truth {
  std::vector<double> image;     // (3, height, width)
  std::vector<double> v_image;   // d loss / d image
  std::vector<double> gradient;  // in the layout of the model
  double loss = 0;
  double contributions = 0;  // mean number of splats that are composited in a pixel
};

oracle::Options oracle_options(const Problem& problem);
Truth compute_truth(const Problem& problem);
StageTruth compute_stage_truth(const Problem& problem);

}  // namespace ubs::accuracy
