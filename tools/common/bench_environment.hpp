// SPDX-License-Identifier: Apache-2.0
// What measurements are stored and compared with.
#pragma once

#include <cstddef>
#include <string>

namespace ubs::tools {

std::string utc_date();  // "2026-11-20T04:09:50Z"
std::string host_name();
std::string command_line();  // of this process, as a shell takes it
// Throws Error(data) where this --baseline has nothing of the run: that must not pass for a success.
void require_compared(const std::string& baseline, std::size_t comparisons);

}  // namespace ubs::tools
