// SPDX-License-Identifier: Apache-2.0
// Date, host and command that measurements are stored with.
#pragma once

#include <string>

namespace ubs::tools {

std::string utc_date();  // "2026-11-20T04:09:50Z"
std::string host_name();
std::string command_line();  // of this process, as a shell takes it

}  // namespace ubs::tools
