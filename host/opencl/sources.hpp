// SPDX-License-Identifier: Apache-2.0
// assemble() creates the source text of a program from the embedded kernel sources
// (host/device/kernel_sources.hpp).
#pragma once

#include <string>
#include <vector>

namespace ubs::opencl {

// Returns one text that contains the headers that all programs need (such as limits.h and layout.h), followed
// by the named files. A #line directive with the name of the file precedes each file.
std::string assemble(const std::vector<std::string>& names);

}  // namespace ubs::opencl
