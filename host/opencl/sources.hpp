// SPDX-License-Identifier: Apache-2.0
// Assembles programs from the embedded kernel sources (host/device/kernel_sources.hpp).
#pragma once

#include <string>
#include <vector>

namespace ubs::opencl {

// Returns the prelude (dialect, limits, layout) and the named files as one text. Each file starts with a
// #line directive with its name.
std::string assemble(const std::vector<std::string>& names);

}  // namespace ubs::opencl
