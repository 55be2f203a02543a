// SPDX-License-Identifier: Apache-2.0
// Libraries of the CUDA toolkit that are opened when something asks for them, so that nothing of the toolkit
// is needed at start.
#pragma once

#include <dlfcn.h>

#include <span>
#include <string>
#include <vector>

#include "host/base/error.hpp"

namespace ubs::cuda {

// Names of a library of the toolkit, "libnvrtc" with "11.2" as its version in CUDA 11, in the order to try. A
// driver loads what libraries of its own major version and older ones make, not that of newer ones: these
// come last, as the library without a number. driver: as cudaDriverGetVersion says, 12040 for CUDA 12.4; 0
// where there is none.
inline std::vector<std::string> toolkit_names(const std::string& stem, const std::string& eleven,
                                              int driver) {
  constexpr int kNewest = 13;  // without a driver, which is for tests
  std::vector<std::string> names;
  for (int major = driver > 0 ? driver / 1000 : kNewest; major >= 12; --major)
    names.push_back(fmt::format("{}.so.{}", stem, major));
  names.push_back(fmt::format("{}.so.{}", stem, eleven));
  names.push_back(stem + ".so");
  names.push_back(fmt::format("/usr/local/cuda/lib64/{}.so", stem));
  return names;
}

// The first of the names that can be opened, for the rest of the process; null when there is none.
inline void* open_first(std::span<const std::string> names) {
  for (const std::string& name : names)
    if (void* library = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL)) return library;
  return nullptr;
}

// Throws Error(device) when the library, called `owner` in the message, has no function of that name.
template <typename Function>
void find_function(void* library, const char* owner, const char* name, Function& function) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (!function) fail(ErrorKind::device, "{} has no function '{}'", owner, name);
}

}  // namespace ubs::cuda
