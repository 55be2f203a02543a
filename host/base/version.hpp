// SPDX-License-Identifier: Apache-2.0
// version() and build_id() identify this program, or the library, in results. The linker computes the build
// ID, a hash of the code. It changes whenever any compiled code changes, and does not depend on
// version control.
#pragma once

#include <string>

namespace ubs {

extern const char* const kVersion;  // number of the release, for example "0.2.0"
std::string version();
// Returns the build ID in hexadecimal digits, or "unknown" if the program was linked without --build-id.
std::string build_id();

}  // namespace ubs
