// SPDX-License-Identifier: Apache-2.0
// Programs of the embedded kernel sources (host/device/kernel_sources.hpp).
#pragma once

#include <string>
#include <vector>

namespace ubs::opencl {

// The prelude (dialect, limits, layout) and the named files, each headed by a #line of its own name.
std::string assemble(const std::vector<std::string>& names);

}  // namespace ubs::opencl
