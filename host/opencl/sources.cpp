// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/sources.hpp"

#include "host/device/kernel_sources.hpp"

namespace ubs::opencl {

std::string assemble(const std::vector<std::string>& names) {
  std::string text;
  const auto append = [&](const std::string& name) {
    text += "#line 1 \"" + name + "\"\n" + kernel_source(name) + "\n";
  };
  for (const char* name :
       {"dialect/dialect.h", "variant.h", "limits.h", "layout.h", "dialect/entry.h", "math/elementary.h"})
    append(name);
  for (const std::string& name : names) append(name);
  return text;
}

}  // namespace ubs::opencl
