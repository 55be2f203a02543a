// SPDX-License-Identifier: Apache-2.0
// Test support: the executable as a user meets it, started as a process in a folder and judged by exit code
// and output. For targets that are compiled with UBS_EXECUTABLE, the path of `ubs`.
#pragma once

#include <sys/wait.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <string>

#include "tests/support/temp_folder.hpp"

namespace ubs::test {

struct Result {
  int code;  // -1: ended by a signal
  std::string out, err;
};

inline std::string quoted(const std::filesystem::path& path) { return fmt::format("'{}'", path.string()); }

// Runs `command` of the shell inside of the folder, where the output stays as stdout.txt and stderr.txt.
inline Result run_command(const TempFolder& folder, const std::string& command) {
  const int status = std::system(
      fmt::format("cd {} && {} >stdout.txt 2>stderr.txt </dev/null", quoted(folder.path()), command).c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, get(folder / "stdout.txt"),
          get(folder / "stderr.txt")};
}

inline Result run_ubs(const TempFolder& folder, const std::string& arguments) {
  return run_command(folder, fmt::format("'{}' {}", UBS_EXECUTABLE, arguments));
}

// As run_ubs; the test ends when the exit code is not 0.
inline Result ubs_ok(const TempFolder& folder, const std::string& arguments) {
  Result result = run_ubs(folder, arguments);
  INFO("ubs " << arguments << "\n" << result.err);
  REQUIRE(result.code == 0);
  return result;
}

// The exit code, no output, and exactly one line on stderr that starts as promised and contains `part`.
inline void check_error(const TempFolder& folder, const std::string& arguments, int code,
                        const std::string& part) {
  const Result result = run_ubs(folder, arguments);
  INFO("ubs " << arguments << "\n" << result.err);
  CHECK(result.code == code);
  CHECK(result.err.starts_with("ubs: error: "));
  CHECK(std::count(result.err.begin(), result.err.end(), '\n') == 1);
  CHECK(result.err.find(part) != std::string::npos);
  CHECK(result.out.empty());
}

}  // namespace ubs::test
