// SPDX-License-Identifier: Apache-2.0
// Identifies this program (or the library) in results: the release, and a hash of its code that the linker
// computes. The hash is independent of version control, and changes whenever any compiled code changes.
#pragma once

#include <string>

namespace ubs {

extern const char* const kVersion;  // "0.2.0"
std::string version();
std::string build_id();  // hexadecimal; "unknown" if linked without --build-id

}  // namespace ubs
