// SPDX-License-Identifier: Apache-2.0
// kernel_source() returns a kernel source. kernels/embed.cmake embeds all kernel sources in the executable.
#pragma once

#include <string>

namespace ubs {

// Returns the text of a source. Its name is relative to kernels/, or to the folder of the project if it is
// device code of a back end. If the environment variable UBS_KERNEL_DIR is set, the sources of kernels/ are
// read from that folder instead. So kernels can be changed without building ubs again.
std::string kernel_source(const std::string& name);

// An entry of kEmbeddedKernels, which is generated during the build. The last entry has a null name.
struct EmbeddedKernel {
  const char *name, *text;
  bool of_back_end;  // outside of kernels/
};
extern const EmbeddedKernel kEmbeddedKernels[];

}  // namespace ubs
