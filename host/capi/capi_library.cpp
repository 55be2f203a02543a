// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for version, errors and log.
#include <algorithm>
#include <cstdio>
#include <string>
#include <string_view>

#include "host/base/stop_request.hpp"
#include "host/base/version.hpp"
#include "host/base/warning.hpp"
#include "host/capi/handles.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs::facade {
namespace {

thread_local char message[1024] = "";

// Replaces the names of command line options in a message by the names of settings and arguments of the
// library, for example "--test-every" by "test_every".
std::string in_library_terms(std::string_view text) {
  std::string result;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t start = std::min(text.find("--", at), text.size());
    const std::size_t end =
        std::min(text.find_first_not_of("abcdefghijklmnopqrstuvwxyz-", start), text.size());
    const std::string option(text.substr(start, end - start));
    std::string key = option.substr(std::min<std::size_t>(2, option.size()));
    std::ranges::replace(key, '-', '_');
    const bool known = key == "device" || key == "overwrite" ||
                       std::ranges::any_of(train_fields(), [&](const auto& f) { return f.key == key; });
    result += text.substr(at, start - at);
    result += known ? key : option;
    at = end;
  }
  return result;
}

}  // namespace

void remember_error(const char* text) noexcept {
  try {
    std::snprintf(message, sizeof message, "%s", in_library_terms(text).c_str());
  } catch (const std::bad_alloc&) {
    std::snprintf(message, sizeof message, "%s", text);
  }
}

}  // namespace ubs::facade

uint32_t ubs_abi_version(void) { return UBS_ABI_VERSION; }

const char* ubs_version(void) { return ubs::kVersion; }

const char* ubs_error_message(void) { return ubs::facade::message; }

void ubs_set_log(ubs_log_function function, void* user) {
  // This function returns no status. If it fails, the previous log function remains set.
  ubs::facade::guarded([&] {
    if (!function) return ubs::set_log({});
    ubs::set_log([function, user](ubs::LogLevel level, const std::string& text) {
      function(user, level == ubs::LogLevel::warning ? 1 : 0, ubs::facade::in_library_terms(text).c_str());
    });
  });
}

void ubs_set_stop_flag(int32_t* flag) { ubs::stop_flag = flag; }
