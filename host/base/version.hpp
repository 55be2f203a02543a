// SPDX-License-Identifier: Apache-2.0
// What identifies this program, or the library where it is one, in results: the release, and a hash of its
// code made by the linker, which holds without version control and differs as soon as anything compiled in
// differs.
#pragma once

#include <string>

namespace ubs {

extern const char* const kVersion;  // "0.2.0"
std::string version();
std::string build_id();  // hexadecimal; "unknown" when linked without --build-id

}  // namespace ubs
