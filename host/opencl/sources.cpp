// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/sources.hpp"

#include <set>
#include <string_view>

#include "host/device/kernel_sources.hpp"

namespace ubs::opencl {

// Adds each source only once. `#pragma once` is removed from the sources, because it is only valid in files
// that are included with #include.
std::string assemble(const std::vector<std::string>& names) {
  constexpr std::string_view kOnce = "#pragma once";
  std::string text;
  std::set<std::string> there;
  const auto append = [&](const std::string& name) {
    if (!there.insert(name).second) return;
    std::string source = kernel_source(name);
    if (const std::size_t at = source.find(kOnce); at != std::string::npos) source.erase(at, kOnce.size());
    text += "#line 1 \"" + name + "\"\n" + source + "\n";
  };
  for (const char* name : {"dialect/dialect.h", "variant.h", "limits.h", "layout.h", "loss_weights.h",
                           "dialect/entry.h", "opencl/stores.h", "math/elementary.h"})
    append(name);
  for (const std::string& name : names) append(name);
  return text;
}

}  // namespace ubs::opencl
