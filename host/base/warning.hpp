// SPDX-License-Identifier: Apache-2.0
// Messages of the library to the user, one line each. Warnings report that ubs continues without something
// that is missing or does not work; notices announce work that takes time. They go to one function of the
// process: that of the executable writes to stderr; programs that use the library set their own.
#pragma once

#include <fmt/format.h>

#include <functional>
#include <string>
#include <utility>

namespace ubs {

enum class LogLevel { notice, warning };
using LogFunction = std::function<void(LogLevel, const std::string&)>;

// Sets the function. It is called by one thread at a time. With an empty function, warnings go to stderr as
// "ubs: warning: TEXT", and notices are discarded.
void set_log(LogFunction log);
void log_line(LogLevel level, const std::string& text) noexcept;

template <typename... Args>
void warn(fmt::format_string<Args...> format, Args&&... args) {
  log_line(LogLevel::warning, fmt::format(format, std::forward<Args>(args)...));
}

// Prints each text at most once per process, because devices are listed several times in a process.
void warn_once(const std::string& text);

}  // namespace ubs
