// SPDX-License-Identifier: Apache-2.0
// These functions return version information of the executable, in addition to host/base/version.hpp.
#pragma once

#include <string>
#include <string_view>

#include "host/base/version.hpp"

namespace ubs::tools {

std::string version_line(std::string_view program = "ubs");  // "ubs 0.2.0 (build ...)"

}  // namespace ubs::tools
