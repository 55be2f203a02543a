// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/sources.hpp"

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string_view>
#include <utility>

#include "host/base/error.hpp"

namespace ubs::opencl {

// Generated: pairs of name and text, ended by a null name.
extern const std::pair<const char*, const char*> kEmbeddedKernels[];

std::string kernel_source(const std::string& name) {
  if (const char* folder = std::getenv("UBS_KERNEL_DIR"); folder && *folder) {
    const std::string path = std::string(folder) + "/" + name;
    std::ifstream file(path);
    if (!file) fail(ErrorKind::build, "{}: cannot read kernel source (UBS_KERNEL_DIR is set)", path);
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }
  for (const auto* entry = kEmbeddedKernels; entry->first; ++entry)
    if (name == entry->first) return entry->second;
  fail(ErrorKind::internal, "kernel source '{}' is not embedded; add it to kernels/embed.cmake", name);
}

std::string assemble(const std::vector<std::string>& names) {
  std::string text;
  const auto append = [&](const std::string& name) {
    text += "#line 1 \"" + name + "\"\n" + kernel_source(name) + "\n";
  };
  for (const char* name : {"dialect/dialect.h", "variant.h", "limits.h", "layout.h", "dialect/entry.h", "math/elementary.h"})
    append(name);
  for (const std::string& name : names) append(name);
  return text;
}

}  // namespace ubs::opencl
