// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cerrno>

namespace ubs {

// Repeats a system call while it fails with EINTR.
template <typename Call>
auto retry_on_eintr(const Call& call) {
  for (;;)
    if (const auto result = call(); result != -1 || errno != EINTR) return result;
}

}  // namespace ubs
