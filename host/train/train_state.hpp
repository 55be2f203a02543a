// SPDX-License-Identifier: Apache-2.0
// TrainState is a copy, in host memory, of all data that a training run needs to continue, except for the
// settings and the data set.
#pragma once

#include <cstdint>
#include <set>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs {

// TrainProgress is the part of the state that describes the progress of the run.
struct TrainProgress {
  int iteration = 0;             // the last completed iteration
  int logged = 0;                // the last iteration whose loss was reported
  std::uint64_t adam_steps = 0;  // number of optimiser steps so far
  double seconds = 0;            // training time so far
  // Draws that are skipped, because a value that is not finite occurred in their iteration.
  std::set<std::uint64_t> skipped_draws;
  int rollbacks = 0;
  std::uint64_t dropped = 0;  // number of splats that were dropped
};

struct TrainState : TrainProgress {
  SplatModel model;
  std::vector<float> moment1, moment2;  // (moment rows, model.count), row-major
  std::vector<float> loss_sums;         // sums of the views since iteration `logged`, as stored by LossLog
  std::vector<float> appearance;        // (training images, 60); empty: no appearance is learnt
  std::vector<float> sky;               // (81), as in SkyStep; empty: no background is learnt
  std::vector<double> cameras;          // CameraRefiner::state(); empty: cameras are not refined
};

// Returns whether all values of the state are finite: parameters, moments, appearance, sky and cameras.
bool is_finite(const TrainState& state);

}  // namespace ubs
