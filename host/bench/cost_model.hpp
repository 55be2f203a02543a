// SPDX-License-Identifier: Apache-2.0
// The one place where the work of a stage is written as formulas of what it works on: bytes that must move
// between memory and the device at least once, floating-point operations that the mathematics needs (an FMA
// is two, a division or square root one, exp and log eight), and vector instructions of the CPU rasterisers.
// These are lower bounds of the algorithm, not what an implementation happens to do: fractions of ceilings
// made from them compare implementations, and a rewrite does not change them. Only tile lists are counted by
// the passes that their kernels take, of which CPUs and GPUs have others.
#pragma once

#include <string_view>

#include "host/bench/blend_count.hpp"

namespace ubs::bench {

struct Cost {
  double bytes = 0;
  double flops = 0;
  double issue_lanes = 0;  // lane-instructions: instructions per pixel block times its 16 pixels
};

// Stages of host/device/stages.hpp by their names, "lists" (count and build), "iteration" (all of one
// training step without refinement), "forward_backward" (of that, what image and gradient need without loss
// and optimiser) and "render" (projection, lists, raster forward). Others cost nothing.
Cost stage_cost(std::string_view stage, const WorkCounts& counts);

// Floating-point operations of conditioning and projecting one splat.
double projection_flops(const ParameterLayout& layout);

}  // namespace ubs::bench
