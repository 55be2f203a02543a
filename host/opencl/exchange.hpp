// SPDX-License-Identifier: Apache-2.0
// By what work-items of a wave exchange values without memory (kernels/gpu/exchange.h).
#pragma once

#include <string_view>

#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

enum class Exchange { none, khr, nvidia, amd };  // UBS_SUBGROUPS

// From the device's extensions and DeviceInfo::subgroup_language. What only a compiler can tell is left open.
Exchange exchange_kind(std::string_view extensions, std::string_view subgroup_language);
Exchange exchange_kind(const OpenclDevice& device);

// The options of a program with it.
Options exchange_options(const OpenclDevice& device, Exchange kind);

// Why lanes of the kernel, which is built with `kind`, cannot exchange values in groups of this size: waves
// must have whole rows of 16 lanes. Empty where they can.
std::string fault_of_rows(const Kernel& kernel, Exchange kind, Range group);
// Runs kernels/gpu/exchange_check.cl and compares its sums. Waits. Empty where they are right.
std::string fault_of_values(OpenclDevice& device, Kernel check);

}  // namespace ubs::opencl
