// SPDX-License-Identifier: Apache-2.0
#include "host/base/warning.hpp"

#include <fmt/format.h>

#include <cstdio>
#include <mutex>
#include <set>

namespace ubs {

void warn_once(const std::string& text) {
  static std::mutex mutex;
  static std::set<std::string> said;
  const std::lock_guard lock(mutex);
  if (!said.insert(text).second) return;
  std::fputs(fmt::format("ubs: warning: {}\n", text).c_str(), stderr);  // fmt::print throws where it cannot
}

}  // namespace ubs
