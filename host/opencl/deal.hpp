// SPDX-License-Identifier: Apache-2.0
// Work-groups by core (kernels/opencl/deal.h): which devices deal them, and what their programs and kernels
// need.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

// PoCL on x86 CPUs of more than one core: its kernels run in this process, and a core knows its number.
bool deals_by_core(const OpenclDevice& device);

// Of so many work-items, to be launched in groups of one.
Range dealt_range(std::size_t items);
std::string deal_option(std::uint32_t cores);
// The kernels' last argument; they leave it as it was. Kernels of one queue may share it.
Buffer<std::uint32_t> make_claims(OpenclDevice& device, std::uint32_t cores);

}  // namespace ubs::opencl
