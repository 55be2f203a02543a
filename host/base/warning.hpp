// SPDX-License-Identifier: Apache-2.0
// Remarks of the library on stderr, for what goes on without what it could not have.
#pragma once

#include <string>

namespace ubs {

// "ubs: warning: TEXT", at most once a process for the same text: devices are listed several times in a process.
void warn_once(const std::string& text);

}  // namespace ubs
