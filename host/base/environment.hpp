// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <string>

namespace ubs {

// The value of an environment variable; empty without one.
inline std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

// Sets an environment variable of the process, also one that has a value. The library itself sets none.
using SetVariable = void (*)(const char* name, const char* value);

// Whether it is switched on: neither missing nor empty nor "0".
inline bool environment_flag(const char* name) {
  const std::string value = environment(name);
  return !value.empty() && value != "0";
}

}  // namespace ubs
