// SPDX-License-Identifier: Apache-2.0
// This file declares the checks of single stages that have inputs of their own. Each runs the stages of a
// device. Results are compared with the embedded float64 results, lists with a stable sort, and copied splats
// with their sources.
#pragma once

#include "host/check/finding.hpp"
#include "host/check/stage_run.hpp"
#include "host/check/vectors.hpp"

namespace ubs::check {

// Checks tile lists of thousands of splats word for word: order, slots, ranges, prefix sums. If the stages
// are for training, also checks lists that are built without waiting for their totals.
Findings check_lists(Device& device, Stages& stages);
// Checks the loss and its gradient with an 8-bit target, and PSNR and SSIM of a clamped image.
Findings check_loss(Device& device, Stages& stages);
// Checks the end of a training step, in one pass and as separate operations: gradient, penalties and Adam are
// compared with double precision. Changes the model of the run.
Findings check_learning(Device& device, StageRun& run, const FormVectors& expected);
// Checks relocation, growth and noise.
Findings check_population(Device& device, Stages& stages, const FormVectors& expected);
// Checks the image metrics on a small network with random weights.
Findings check_networks(Device& device);

}  // namespace ubs::check
