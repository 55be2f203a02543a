// SPDX-License-Identifier: Apache-2.0
// Remarks of the library for the user, in lines: what goes on without what it could not have (warnings), and
// what takes time (notices). They go to one function of the process: the executable's writes to stderr,
// programs that use the library set their own.
#pragma once

#include <fmt/format.h>

#include <functional>
#include <string>
#include <utility>

namespace ubs {

enum class LogLevel { notice, warning };
using LogFunction = std::function<void(LogLevel, const std::string&)>;

// Called by one thread at a time. An empty function: warnings go to stderr as "ubs: warning: TEXT", notices
// nowhere.
void set_log(LogFunction log);
void log_line(LogLevel level, const std::string& text) noexcept;

template <typename... Args>
void warn(fmt::format_string<Args...> format, Args&&... args) {
  log_line(LogLevel::warning, fmt::format(format, std::forward<Args>(args)...));
}

// At most once a process for the same text: devices are listed several times in a process.
void warn_once(const std::string& text);

}  // namespace ubs
