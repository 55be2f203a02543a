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

// Type of a function that sets an environment variable of the process and replaces an existing value. Only
// the executable passes such a function; the library never sets environment variables.
using SetVariable = void (*)(const char* name, const char* value);

// Returns whether an environment variable is set to a string that is neither empty nor "0".
inline bool environment_flag(const char* name) {
  const std::string value = environment(name);
  return !value.empty() && value != "0";
}

}  // namespace ubs
