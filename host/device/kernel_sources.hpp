// SPDX-License-Identifier: Apache-2.0
// kernel_source() returns a kernel source. kernels/embed.cmake embeds all kernel sources in the executable.
#pragma once

#include <string>

namespace ubs {

// Returns the text of a source. Its name is relative to kernels/, or starts with "cuda_backend/" if it is
// device code of the CUDA back end. If the environment variable UBS_KERNEL_DIR is set, the sources of
// kernels/ are read from that folder instead. So kernels can be changed without building ubs again.
std::string kernel_source(const std::string& name);

}  // namespace ubs
