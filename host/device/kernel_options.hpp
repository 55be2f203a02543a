// SPDX-License-Identifier: Apache-2.0
// From a KernelConfig to the macros that specialise kernels, for all back ends: "-DNAME=VALUE" for every
// switch that is not at its default. A default program has none of them, so that its name in a cache does not
// depend on which switches exist.
#pragma once

#include <string>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

using Options = std::vector<std::string>;

void append(Options& options, const Options& more);

// Switches of kernels/variant.h.
Options variant_options(const ModelVariant& variant);
// Of these the spatial kernel alone.
Options falloff_options(const ModelVariant& variant);
// Of projection and rasteriser: splats and pixels whose alpha does not count, backward.
Options extent_options(const KernelConfig& config);
// UBS_FROZEN: of programs that touch gradients or moments.
Options frozen_options(const KernelConfig& config);
// UBS_DEPTH_GRAD: of programs that take gradients of projected splats further.
Options depth_gradient_options(const KernelConfig& config);
Options arithmetic_options(MathMode math);
// Of the rasterisers: kernel, extents, work that is left out, gradients that nobody asks for, depth,
// arithmetic.
Options raster_options(const KernelConfig& config);

}  // namespace ubs
