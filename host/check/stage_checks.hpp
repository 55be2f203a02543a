// SPDX-License-Identifier: Apache-2.0
// The checks of single stages that have inputs of their own. Each runs the stages of a device and compares
// with the embedded float64 results, lists with a stable sort, and copies of splats with what they are copies
// of.
#pragma once

#include "host/check/finding.hpp"
#include "host/check/stage_run.hpp"
#include "host/check/vectors.hpp"

namespace ubs::check {

// Tile lists of thousands of splats, word for word: order, slots, ranges, prefix sums; where the stages are
// for training also those that do not wait for their totals.
Findings check_lists(Device& device, Stages& stages);
// Loss and gradient against an 8-bit target, PSNR and SSIM of a clamped image.
Findings check_loss(Device& device, Stages& stages);
// A step's end in one pass and in pieces: gradient, penalties, Adam, each against double. Changes the model
// of the run.
Findings check_learning(Device& device, StageRun& run, const FormVectors& expected);
// Relocation, growth and noise.
Findings check_population(Device& device, Stages& stages, const FormVectors& expected);
// Image metrics of a small network with random weights.
Findings check_networks(Device& device);

}  // namespace ubs::check
