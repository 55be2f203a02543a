// SPDX-License-Identifier: Apache-2.0
// What the executable says of itself beside host/base/version.hpp.
#pragma once

#include <string>
#include <string_view>

#include "host/base/version.hpp"

namespace ubs::tools {

std::string commit();  // of the sources at the last link, "-dirty" when changed; "unknown" without git
std::string version_line(std::string_view program = "ubs");  // "ubs 0.2.0 (build ...)"

}  // namespace ubs::tools
