// SPDX-License-Identifier: Apache-2.0
// A program in a process of its own. A training run that crashes its driver, runs out of memory or aborts
// then ends alone, and its device memory is given back whole, whatever state it was in.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace ubs::experiment {

struct ChildResult {
  int code = 0;    // exit code, where it ended by itself
  int signal = 0;  // that ended it, else 0
};

enum class Request { none, interrupt, kill };  // interrupt: SIGINT, which lets it save

// Standard output and error go to `log` behind the command, standard input is empty. `poll` is
// asked about every 50 ms and may ask the child to end; SIGINT is sent once only. A child gets SIGTERM when
// this process dies. Throws Error(internal) when no process can be made.
ChildResult run_child(const std::vector<std::string>& arguments, const std::filesystem::path& log,
                      const std::function<Request()>& poll);

}  // namespace ubs::experiment
