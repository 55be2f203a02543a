// SPDX-License-Identifier: Apache-2.0
// Runs another program, such as COLMAP, as a child process.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace ubs {

struct ChildResult {
  int code = 0;    // exit code, if it exited by itself
  int signal = 0;  // signal that ended it, otherwise 0
};

// Runs the program and waits for its end. Its standard output and error are appended to `log`, after a line
// with the command; its standard input is empty. `stop` is called about every 50 ms, and the child is killed
// if it returns true. The system sends the child SIGTERM when this process dies. Throws Error(internal) if no
// process can be created.
ChildResult run_child(const std::vector<std::string>& arguments, const std::filesystem::path& log,
                      const std::function<bool()>& stop);

// Returns the path of an executable: `name` itself if it has a slash in it, otherwise the first one of that
// name in a folder of PATH. Empty if there is none.
std::filesystem::path find_program(const std::string& name);

}  // namespace ubs
