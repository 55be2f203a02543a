// SPDX-License-Identifier: Apache-2.0
// Converts a KernelConfig to the macros that specialise kernels, for all back ends. There is a "-DNAME=VALUE"
// for every switch that does not have its default value. So a default program has none, and its name in a
// cache does not depend on which switches exist.
#pragma once

#include <string>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

using Options = std::vector<std::string>;

void append(Options& options, const Options& more);

// Returns the switches of kernels/variant.h. Those of a config include its own falloff if it has one.
Options variant_options(const ModelVariant& variant);
Options variant_options(const KernelConfig& config);
// Returns only the switch of the spatial kernel.
Options falloff_options(const KernelConfig& config);
// Returns the switches of projection and rasteriser that limit the work: the smallest alpha that contributes,
// and whether there is a backward pass.
Options extent_options(const KernelConfig& config);
// Returns UBS_FROZEN, for programs that use gradients or moments.
Options frozen_options(const KernelConfig& config);
// Returns UBS_DEPTH_GRAD, for programs that process gradients of projected splats further.
Options depth_gradient_options(const KernelConfig& config);
Options arithmetic_options(MathMode math);
// Returns the switches of the rasterisers: spatial kernel, extents, skipped work, gradients that are not
// requested, depth, and arithmetic.
Options raster_options(const KernelConfig& config);

}  // namespace ubs
