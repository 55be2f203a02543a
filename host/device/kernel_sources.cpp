// SPDX-License-Identifier: Apache-2.0
#include "host/device/kernel_sources.hpp"

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <utility>

#include "host/base/error.hpp"

namespace ubs {

// This array is generated during the build. It contains the name and the text of each source. The last entry
// has a null name.
extern const std::pair<const char*, const char*> kEmbeddedKernels[];

std::string kernel_source(const std::string& name) {
  const char* folder = std::getenv("UBS_KERNEL_DIR");
  if (folder && *folder && !name.starts_with("cuda_backend/")) {
    const std::string path = std::string(folder) + "/" + name;
    std::ifstream file(path);
    if (!file)
      fail(ErrorKind::build, "{}: cannot read this kernel source: check the value of UBS_KERNEL_DIR", path);
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }
  for (const auto* entry = kEmbeddedKernels; entry->first; ++entry)
    if (name == entry->first) return entry->second;
  fail(ErrorKind::internal, "kernel source '{}' is not embedded; add it to kernels/CMakeLists.txt", name);
}

}  // namespace ubs
