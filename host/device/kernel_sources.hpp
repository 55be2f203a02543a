// SPDX-License-Identifier: Apache-2.0
// Access to the kernel sources, which kernels/embed.cmake embeds in the executable.
#pragma once

#include <string>

namespace ubs {

// Returns the text of a source. Its name is relative to kernels/, or starts with "cuda_backend/" for device
// code of CUDA. If the environment variable UBS_KERNEL_DIR is set, sources of kernels/ are read from that
// folder instead, which allows development without rebuilding.
std::string kernel_source(const std::string& name);

}  // namespace ubs
