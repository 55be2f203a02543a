// SPDX-License-Identifier: Apache-2.0
// These functions return the date, the host and the command line, which are stored with measurements.
#pragma once

#include <string>

namespace ubs::tools {

std::string utc_date();  // the current date and time, such as "2026-11-20T04:09:50Z"
std::string host_name();
std::string command_line();  // the command line of this process, quoted for a shell

}  // namespace ubs::tools
