// SPDX-License-Identifier: Apache-2.0
// This file declares checks of single stages. Each check runs a stage of a device with its own inputs. The
// results are compared with the embedded float64 results, except that lists are compared with those of a
// stable sort, and copied splats with the splats that they were copied from.
#pragma once

#include "host/check/finding.hpp"
#include "host/check/stage_run.hpp"
#include "host/check/vectors.hpp"

namespace ubs::check {

// Checks tile lists of thousands of splats. The order, slots, ranges and prefix sums must be exactly the
// expected ones. If the stages have a backward pass, also checks lists that are built without waiting for the
// number of intersections.
Findings check_lists(Device& device, Stages& stages);
// Checks the loss and its gradient for an 8-bit target image, and PSNR and SSIM of a clamped image.
Findings check_loss(Device& device, Stages& stages);
// Checks the end of a training step: the gradient of the parameters, the penalties and Adam. Checks both the
// operation that does all of these in one pass, and the separate operations. The model of the run is
// unchanged afterwards.
Findings check_learning(Device& device, StageRun& run, const FormVectors& expected);
// Checks relocation, growth and noise.
Findings check_population(Device& device, Stages& stages, const FormVectors& expected);
// Checks the image metrics on a small network with random weights.
Findings check_networks(Device& device);

}  // namespace ubs::check
