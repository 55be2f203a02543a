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
  if (said.insert(text).second) fmt::print(stderr, "ubs: warning: {}\n", text);
}

}  // namespace ubs
