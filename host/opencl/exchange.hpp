// SPDX-License-Identifier: Apache-2.0
// These functions select how the work-items of a wave exchange values without memory
// (kernels/gpu/exchange.h), and check whether this works.
#pragma once

#include <string_view>

#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

enum class Exchange { none, khr, nvidia, amd };  // the values of UBS_SUBGROUPS

// Returns the mechanism that the device's extensions and DeviceInfo::subgroup_language suggest. The functions
// below check whether it works.
Exchange exchange_kind(std::string_view extensions, std::string_view subgroup_language);
Exchange exchange_kind(const OpenclDevice& device);

// Returns the options for a program that uses this mechanism.
Options exchange_options(const OpenclDevice& device, Exchange kind);

// Returns the reason why the lanes of a kernel cannot exchange values in groups of this size, or an empty
// string if they can. `kind` is the mechanism that the kernel was built with. Waves must consist of whole
// rows of 16 lanes.
std::string fault_of_rows(const Kernel& kernel, Exchange kind, Range group);
// Runs kernels/gpu/exchange_check.cl, waits for the device, and compares the sums with the expected ones.
// Returns an error message if they differ, or an empty string if they are right.
std::string fault_of_values(OpenclDevice& device, Kernel check);

}  // namespace ubs::opencl
