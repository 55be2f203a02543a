// SPDX-License-Identifier: Apache-2.0
// Libraries of the CUDA toolkit that are opened when something asks for them, so that nothing of the toolkit
// is needed at start.
#pragma once

#include <dlfcn.h>

#include <span>

#include "host/base/error.hpp"

namespace ubs::cuda {

// The first of the names that can be opened, for the rest of the process; null when there is none.
inline void* open_first(std::span<const char* const> names) {
  for (const char* name : names)
    if (void* library = dlopen(name, RTLD_NOW | RTLD_LOCAL)) return library;
  return nullptr;
}

// Throws Error(device) when the library, called `owner` in the message, has no function of that name.
template <typename Function>
void find_function(void* library, const char* owner, const char* name, Function& function) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (!function) fail(ErrorKind::device, "{} has no function '{}'", owner, name);
}

}  // namespace ubs::cuda
