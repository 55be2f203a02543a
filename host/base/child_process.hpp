// SPDX-License-Identifier: Apache-2.0
// run_child() runs another program, such as COLMAP, as a child process.
#pragma once

#include <csignal>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace ubs {

// Signals that child processes must not ignore, even if this process ignores them: ubs ignores SIGPIPE and
// SIGXFSZ itself, and daemons may start it with SIGCHLD ignored. execv() keeps ignored signals ignored.
constexpr int kSignalsOfChildren[] = {SIGPIPE, SIGXFSZ, SIGCHLD};

struct ChildResult {
  int code = 0;    // exit code of the program, or 0 if a signal ended it
  int signal = 0;  // number of the signal that ended the program, or 0 if it exited by itself
};

// Runs the program arguments[0] and waits until it ends. Replaces the file `log` by a file that contains the
// command and then the standard output and the standard error of the program. The standard input is empty.
// Calls `stop` about every 50 ms, and kills the program if `stop` returns true. If this process dies, the
// operating system sends SIGTERM to the program. Throws Error(data) if the log cannot be written, and
// Error(internal) if no process can be created.
// In a program that uses ubs as a library and ignores SIGCHLD, or waits for all of its child processes
// itself, the operating system does not tell how the program ended, and the result is {0, 0}. The executable
// does not ignore SIGCHLD.
ChildResult run_child(const std::vector<std::string>& arguments, const std::filesystem::path& log,
                      const std::function<bool()>& stop);

// Returns the path of an executable, or an empty path if it is not found. If `name` contains a slash, it is
// the path itself. Otherwise the folders of PATH are searched for an executable with this name.
std::filesystem::path find_program(const std::string& name);

}  // namespace ubs
