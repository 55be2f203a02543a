// SPDX-License-Identifier: Apache-2.0
// These functions send messages to the user, one line each. A warning reports that ubs continues although
// something is missing or does not work; a notice announces work that takes time. All messages of a process
// are passed to one function. The function of the executable writes them to stderr; programs that use the
// library set their own function.
#pragma once

#include <fmt/format.h>

#include <functional>
#include <string>
#include <utility>

namespace ubs {

enum class LogLevel { notice, warning };
using LogFunction = std::function<void(LogLevel, const std::string&)>;

// Sets the function that receives all messages. Only one thread at a time calls it. If the function is empty,
// warnings are written to stderr as "ubs: warning: TEXT", and notices are discarded.
void set_log(LogFunction log);
void log_line(LogLevel level, const std::string& text) noexcept;

template <typename... Args>
void warn(fmt::format_string<Args...> format, Args&&... args) {
  log_line(LogLevel::warning, fmt::format(format, std::forward<Args>(args)...));
}

// Logs each text as a warning at most once per process. It is used for warnings about devices, because a
// process lists its devices several times.
void warn_once(const std::string& text);

}  // namespace ubs
