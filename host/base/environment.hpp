// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <string>

namespace ubs {

// Returns the value of an environment variable, or an empty string if it is not set.
inline std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

// Sets an environment variable of the process, replacing its value if it has one. The library itself never
// sets any.
using SetVariable = void (*)(const char* name, const char* value);

// Returns whether a variable is switched on: it is set, not empty and not "0".
inline bool environment_flag(const char* name) {
  const std::string value = environment(name);
  return !value.empty() && value != "0";
}

}  // namespace ubs
