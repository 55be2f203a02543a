// SPDX-License-Identifier: Apache-2.0
// The kernel sources embedded in the executable by kernels/embed.cmake.
#pragma once

#include <string>

namespace ubs {

// Text of one source by its name relative to kernels/, or of device code "cuda_backend/...". With the
// environment variable UBS_KERNEL_DIR those of kernels/ are read from that folder instead (for developing
// without rebuilding).
std::string kernel_source(const std::string& name);

}  // namespace ubs
