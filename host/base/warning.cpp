// SPDX-License-Identifier: Apache-2.0
#include "host/base/warning.hpp"

#include <cstdio>
#include <mutex>
#include <set>

#include "host/base/text.hpp"

namespace ubs {
namespace {

struct Log {
  std::recursive_mutex mutex;  // recursive, because a log function may set another one
  LogFunction function;
};

Log& the_log() {
  static Log log;
  return log;
}

}  // namespace

void set_log(LogFunction function) {
  const std::lock_guard lock(the_log().mutex);
  the_log().function = std::move(function);
}

void log_line(LogLevel level, const std::string& whole) noexcept {
  try {
    const std::string text = shortened(whole);
    const std::lock_guard lock(the_log().mutex);
    if (const LogFunction function = the_log().function)
      function(level, text);
    else if (level == LogLevel::warning)
      std::fputs(fmt::format("ubs: warning: {}\n", encode_text(text)).c_str(), stderr);
  } catch (...) {  // the program continues if a message cannot be printed
  }
}

void warn_once(const std::string& text) {
  static std::mutex mutex;
  static std::set<std::string> said;
  {
    const std::lock_guard lock(mutex);
    if (!said.insert(text).second) return;
  }
  log_line(LogLevel::warning, text);
}

}  // namespace ubs
