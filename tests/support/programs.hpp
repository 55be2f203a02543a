// SPDX-License-Identifier: Apache-2.0
// program_of() returns the program that has a subcommand. It can be used in targets that are compiled with
// UBS_EXECUTABLE and UBS_LAB_EXECUTABLE, which are the paths of `ubs` and `ubs-lab`.
#pragma once

#include <algorithm>
#include <array>
#include <string>
#include <string_view>

namespace ubs::test {

// Returns the path of the program for a command line that begins with a subcommand.
inline std::string program_of(std::string_view arguments) {
  constexpr std::array kLab{"accuracy", "bench", "compare", "gradients", "stress", "tune"};
  const bool lab = std::ranges::find(kLab, arguments.substr(0, arguments.find(' '))) != kLab.end();
  return lab ? UBS_LAB_EXECUTABLE : UBS_EXECUTABLE;
}

}  // namespace ubs::test
