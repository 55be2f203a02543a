// SPDX-License-Identifier: Apache-2.0
// All that a training run needs to go on, on the host: everything else follows from settings and data.
#pragma once

#include <cstdint>
#include <set>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs {

// How far a run is.
struct TrainProgress {
  int iteration = 0;  // the last one that is done
  int logged = 0;     // the last one whose loss has been reported
  std::uint64_t adam_steps = 0;
  double seconds = 0;                     // of training
  std::set<std::uint64_t> skipped_draws;  // views left out after a value was not finite
  int rollbacks = 0;
  std::uint64_t dropped = 0;  // splats
};

struct TrainState : TrainProgress {
  SplatModel model;
  std::vector<float> moment1, moment2;  // (rows of moments) x model.count, row-major
  std::vector<float> loss_sums;         // of the views since `logged`, as the trainer keeps them
  std::vector<float> appearance;        // (training images, 60), or empty: not learnt
  std::vector<float> sky;               // (81) of SkyStep, or empty: not learnt
  std::vector<double> cameras;          // CameraRefiner::state(), or empty: as given
};

// Whether every parameter and moment is finite.
bool is_finite(const TrainState& state);

}  // namespace ubs
