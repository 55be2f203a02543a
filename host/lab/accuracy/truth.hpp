// SPDX-License-Identifier: Apache-2.0
// The float64 side: one view of a model, its loss and gradient by the oracle of host/lab/oracle, which is
// written from the method alone and differentiates by a tape; end to end, and stage by stage on inputs that
// are exact float64 results rounded to float32.
#pragma once

#include <vector>

#include "host/check/stage_truth.hpp"
#include "host/lab/oracle/oracle.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::accuracy {

using check::Problem;
using check::StageTruth;

// Planar 8-bit image / 255.
std::vector<float> planar_target(const Image8& image);

struct Truth {
  std::vector<double> image;     // (3, height, width)
  std::vector<double> v_image;   // d loss / d image
  std::vector<double> gradient;  // layout of the model
  double loss = 0;
};

oracle::Options oracle_options(const Problem& problem);
Truth compute_truth(const Problem& problem);
StageTruth compute_stage_truth(const Problem& problem);

}  // namespace ubs::accuracy
