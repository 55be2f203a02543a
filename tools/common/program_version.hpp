// SPDX-License-Identifier: Apache-2.0
// These functions return version information of the executable, in addition to host/base/version.hpp.
#pragma once

#include <string>
#include <string_view>

#include "host/base/version.hpp"

namespace ubs::tools {

// Returns the commit of the sources from which the executable was linked, with "-dirty" if they differ from
// the commit, or "unknown" if there was no git repository.
std::string commit();
std::string version_line(std::string_view program = "ubs");  // "ubs 0.2.0 (build ...)"

}  // namespace ubs::tools
