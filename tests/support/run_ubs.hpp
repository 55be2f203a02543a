// SPDX-License-Identifier: Apache-2.0
// run_ubs() runs `ubs` or `ubs-lab` as a process in a folder, and returns its exit code and output.
// `arguments` begin with the subcommand, which determines the program.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <sstream>
#include <string>
#include <thread>

#include "tests/support/programs.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::test {

struct Result {
  int code;  // -1: terminated by a signal
  std::string out, err;
};

inline std::string quoted(const std::filesystem::path& path) { return fmt::format("'{}'", path.string()); }

// Runs a shell command in the folder. Its output is stored in the files stdout.txt and stderr.txt of the
// folder.
inline Result run_command(const TempFolder& folder, const std::string& command) {
  const int status = std::system(
      fmt::format("cd {} && {} >stdout.txt 2>stderr.txt </dev/null", quoted(folder.path()), command).c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, get(folder / "stdout.txt"),
          get(folder / "stderr.txt")};
}

inline Result run_ubs(const TempFolder& folder, const std::string& arguments) {
  return run_command(folder, fmt::format("'{}' {}", program_of(arguments), arguments));
}

// Does the same as run_ubs(), but ends the test if the exit code is not 0.
inline Result ubs_ok(const TempFolder& folder, const std::string& arguments) {
  Result result = run_ubs(folder, arguments);
  INFO("ubs " << arguments << "\n" << result.err);
  REQUIRE(result.code == 0);
  return result;
}

// Returns a log.csv without the columns that depend on the clock. These are the second column, which contains
// the seconds, and all columns after the sixth, because the time determines when a sample of the test views
// is measured.
inline std::string without_seconds(const std::string& log) {
  std::string text;
  std::istringstream lines(log);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t first = line.find(','), second = line.find(',', first + 1);
    std::size_t end = second;
    for (int column = 2; column < 6 && end != std::string::npos; ++column) end = line.find(',', end + 1);
    text += line.substr(0, first) + line.substr(second, end - second) + "\n";
  }
  return text;
}

// Starts the command, waits until `file` exists in the folder and is not empty, and sends the signal. `file`
// may be out.txt or err.txt, which contain the output of the command. `before` is a command that runs the
// program, for example env with variables. Returns the exit code, or 128 plus the number of the signal that
// ended the process.
inline int ended_by(const TempFolder& folder, const std::string& arguments, int signal,
                    const std::string& file, const std::string& before = "") {
  using Clock = std::chrono::steady_clock;
  for (const char* output : {"out.txt", "err.txt"}) std::filesystem::remove(folder / output);
  const std::string command =
      fmt::format("exec {} '{}' {} >out.txt 2>err.txt </dev/null", before, program_of(arguments), arguments);
  const pid_t child = ::fork();
  if (child == 0) {
    for (const int number : {SIGINT, SIGTERM, SIGHUP}) std::signal(number, SIG_DFL);
    if (::chdir(folder.path().c_str()) == 0) ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    ::_exit(127);
  }
  REQUIRE(child > 0);
  const auto there = [&] { return !get(folder / file).empty(); };
  for (const auto end = Clock::now() + std::chrono::minutes(10); Clock::now() < end && !there();)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  CHECK(there());
  ::kill(child, signal);
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

// Runs the command and checks that it fails with the exit code `code`, that it writes nothing to stdout, and
// that it writes exactly one line to stderr. This line must start with the name of the program and "error:",
// and must contain `part`.
inline void check_error(const TempFolder& folder, const std::string& arguments, int code,
                        const std::string& part) {
  const Result result = run_ubs(folder, arguments);
  INFO("ubs " << arguments << "\n" << result.err);
  CHECK(result.code == code);
  CHECK_THAT(result.err, Catch::Matchers::Matches("ubs(-lab)?: error: [^\n]*\n"));
  CHECK(result.err.find(part) != std::string::npos);
  CHECK(result.out.empty());
}

}  // namespace ubs::test
