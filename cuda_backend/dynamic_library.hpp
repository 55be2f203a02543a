// SPDX-License-Identifier: Apache-2.0
// Functions that open libraries of the CUDA toolkit at their first use, so that the program also starts
// without the toolkit.
#pragma once

#include <dlfcn.h>

#include <span>
#include <string>
#include <vector>

#include "host/base/error.hpp"

namespace ubs::cuda {

// Returns the names under which a library of the toolkit may be found, in the order to try them. `eleven` is
// the version that the library has in CUDA 11, for example "11.2" for "libnvrtc". `driver` is the result of
// cudaDriverGetVersion, for example 12040 for CUDA 12.4, or 0 without a driver.
// A driver can load code that a library of the same or an older major version has made, but no code of newer
// libraries. Therefore names without a version come last, because they may refer to a newer library.
inline std::vector<std::string> toolkit_names(const std::string& stem, const std::string& eleven,
                                              int driver) {
  constexpr int kNewest = 13;  // major version to start with if there is no driver, as in tests
  std::vector<std::string> names;
  for (int major = driver > 0 ? driver / 1000 : kNewest; major >= 12; --major)
    names.push_back(fmt::format("{}.so.{}", stem, major));
  names.push_back(fmt::format("{}.so.{}", stem, eleven));
  names.push_back(stem + ".so");
  names.push_back(fmt::format("/usr/local/cuda/lib64/{}.so", stem));
  return names;
}

// Opens the first library that is found under one of the names, and keeps it open for the rest of the
// process. Returns null if there is none.
inline void* open_first(std::span<const std::string> names) {
  for (const std::string& name : names)
    if (void* library = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL)) return library;
  return nullptr;
}

// Throws Error(device) if the library does not have this function. The message calls the library `owner`.
template <typename Function>
void find_function(void* library, const char* owner, const char* name, Function& function) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (!function) fail(ErrorKind::device, "{} has no function '{}'", owner, name);
}

}  // namespace ubs::cuda
