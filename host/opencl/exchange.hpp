// SPDX-License-Identifier: Apache-2.0
// Selects how the work-items of a wave exchange values without memory (kernels/gpu/exchange.h).
#pragma once

#include <string_view>

#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

enum class Exchange { none, khr, nvidia, amd };  // UBS_SUBGROUPS

// Returns the mechanism that the device's extensions and DeviceInfo::subgroup_language suggest. The functions
// below check whether it works.
Exchange exchange_kind(std::string_view extensions, std::string_view subgroup_language);
Exchange exchange_kind(const OpenclDevice& device);

// Returns the options for a program that uses it.
Options exchange_options(const OpenclDevice& device, Exchange kind);

// Returns why the lanes of the kernel, which was built with `kind`, cannot exchange values in groups of this
// size, or an empty string if they can. Waves must consist of whole rows of 16 lanes.
std::string fault_of_rows(const Kernel& kernel, Exchange kind, Range group);
// Runs kernels/gpu/exchange_check.cl and compares its sums. Returns an empty string if they are right. Waits
// for the device.
std::string fault_of_values(OpenclDevice& device, Kernel check);

}  // namespace ubs::opencl
