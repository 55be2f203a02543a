// SPDX-License-Identifier: Apache-2.0
// What identifies this executable in results: the release, and a hash of its code made by the linker,
// which holds without version control and differs as soon as anything compiled in differs.
#pragma once

#include <string>

namespace ubs::tools {

std::string version();       // "0.1.0"
std::string build_id();      // hexadecimal; "unknown" when linked without --build-id
std::string commit();        // of the sources at the last link, "-dirty" when changed; "unknown" without git
std::string version_line();  // "ubs 0.1.0 (build ...)"

}  // namespace ubs::tools
