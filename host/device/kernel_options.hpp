// SPDX-License-Identifier: Apache-2.0
// These functions convert a KernelConfig to compiler options that define the macros which specialise kernels,
// for all back ends. The options contain "-DNAME=VALUE" for every switch that does not have its default
// value. Therefore a program with default values has no such options, and its name in the kernel cache does
// not change if a new switch is added to the code.
#pragma once

#include <string>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

using Options = std::vector<std::string>;

void append(Options& options, const Options& more);

// Returns the switches of kernels/variant.h. For a KernelConfig, they include those of a user-defined
// falloff.
Options variant_options(const ModelVariant& variant);
Options variant_options(const KernelConfig& config);
// Returns the switches of the falloff of the spatial kernel.
Options falloff_options(const KernelConfig& config);
// Returns the switches of projection and rasteriser that limit the work: the smallest alpha that contributes,
// and whether there is a backward pass.
Options extent_options(const KernelConfig& config);
// Returns UBS_FROZEN, for programs that use gradients or moments.
Options frozen_options(const KernelConfig& config);
// Returns UBS_DEPTH_GRAD, for programs that read the gradients of projected splats.
Options depth_gradient_options(const KernelConfig& config);
// Returns UBS_GAUSSIAN_ARRAYS, for programs that read parameters or write their gradients.
Options array_options(const KernelConfig& config);
// Returns UBS_MATH, which selects exact or approximate arithmetic.
Options arithmetic_options(MathMode math);
// Returns the switches of the rasterisers. They select whether depth and absolute gradients are computed, the
// falloff of the spatial kernel, the smallest alpha, whether there is a backward pass, which gradients are
// not needed, and the arithmetic.
Options raster_options(const KernelConfig& config);

}  // namespace ubs
