// SPDX-License-Identifier: Apache-2.0
// on_stderr() returns the text that is written to file descriptor 2 while an action runs. This includes the
// text that C libraries print to stderr.
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cstdio>
#include <string>

#include "tests/support/temp_folder.hpp"

namespace ubs::test {

template <typename Action>
std::string on_stderr(const Action& action) {
  const TempFolder folder;
  std::fflush(stderr);
  const int kept = ::dup(STDERR_FILENO);
  const int file = ::open((folder / "err").c_str(), O_WRONLY | O_CREAT, 0600);
  ::dup2(file, STDERR_FILENO);
  action();
  std::fflush(stderr);
  ::dup2(kept, STDERR_FILENO);
  ::close(kept);
  ::close(file);
  return get(folder / "err");
}

}  // namespace ubs::test
