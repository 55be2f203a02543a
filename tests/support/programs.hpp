// SPDX-License-Identifier: Apache-2.0
// program_of() returns the path of the program, `ubs` or `ubs-lab`, that a command line is for. It can be
// used in targets that are compiled with the macros UBS_EXECUTABLE and UBS_LAB_EXECUTABLE, which contain
// these paths.
#pragma once

#include <algorithm>
#include <array>
#include <string>
#include <string_view>

namespace ubs::test {

// `arguments` is a command line without the program. Its first word is the subcommand.
inline std::string program_of(std::string_view arguments) {
  constexpr std::array kLab{"accuracy", "bench", "compare", "gradients", "stress", "tune"};
  const bool lab = std::ranges::find(kLab, arguments.substr(0, arguments.find(' '))) != kLab.end();
  return lab ? UBS_LAB_EXECUTABLE : UBS_EXECUTABLE;
}

}  // namespace ubs::test
