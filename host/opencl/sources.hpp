// SPDX-License-Identifier: Apache-2.0
// The kernel sources embedded in the executable by kernels/embed.cmake.
#pragma once

#include <string>
#include <vector>

namespace ubs::opencl {

// Text of one source by its name relative to kernels/. With the environment variable UBS_KERNEL_DIR it
// is read from that folder instead (for developing kernels without rebuilding).
std::string kernel_source(const std::string& name);

// The prelude (dialect, limits, layout) and the named files, each headed by a #line of its own name.
std::string assemble(const std::vector<std::string>& names);

}  // namespace ubs::opencl
