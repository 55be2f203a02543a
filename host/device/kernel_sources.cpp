// SPDX-License-Identifier: Apache-2.0
#include "host/device/kernel_sources.hpp"

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "host/base/error.hpp"

namespace ubs {

std::string kernel_source(const std::string& name) {
  const EmbeddedKernel* entry = kEmbeddedKernels;
  while (entry->name && name != entry->name) ++entry;
  const char* folder = std::getenv("UBS_KERNEL_DIR");
  if (folder && *folder && !entry->of_back_end) {
    const std::string path = std::string(folder) + "/" + name;
    std::ifstream file(path);
    if (!file)
      fail(ErrorKind::build, "{}: cannot read this kernel source: check the value of UBS_KERNEL_DIR", path);
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }
  if (!entry->name)
    fail(ErrorKind::internal, "kernel source '{}' is not embedded; add it to kernels/CMakeLists.txt", name);
  return entry->text;
}

}  // namespace ubs
