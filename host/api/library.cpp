// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for version, errors and log.
#include <cstdio>

#include "host/api/handles.hpp"
#include "host/base/version.hpp"
#include "host/base/warning.hpp"

namespace ubs::facade {
namespace {

thread_local char message[1024] = "";

}  // namespace

void remember_error(const char* text) noexcept { std::snprintf(message, sizeof message, "%s", text); }

}  // namespace ubs::facade

uint32_t ubs_abi_version(void) { return UBS_ABI_VERSION; }

const char* ubs_version(void) { return ubs::kVersion; }

const char* ubs_error_message(void) { return ubs::facade::message; }

void ubs_set_log(ubs_log_function function, void* user) {
  // This function has no status to return. If it fails, the log stays as it was.
  ubs::facade::guarded([&] {
    if (!function) return ubs::set_log({});
    ubs::set_log([function, user](ubs::LogLevel level, const std::string& text) {
      function(user, level == ubs::LogLevel::warning ? 1 : 0, text.c_str());
    });
  });
}
