// SPDX-License-Identifier: Apache-2.0
// A program with subcommands: `ubs` (tools/main.cpp) and `ubs-lab` (tools/lab/main.cpp). Every failure
// becomes one line on stderr and the exit code of its kind (host/base/error.hpp).
#pragma once

#include <functional>
#include <span>

namespace CLI {
class App;
}

namespace ubs::tools {

// What to run once the command line has been parsed; the result of run() is the exit code.
struct Command {
  CLI::App* app;
  std::function<int()> run;
};

struct CommandEntry {
  Command (*add)(CLI::App& root);              // declares the subcommand with its options
  const char* group;                           // its heading in --help
  const char *first_example, *second_example;  // of a command line
  bool runs_on_ranks = false;                  // several processes may share its work (docs/cluster.md)
};

struct Program {
  const char *name, *description;
  const char* exit_codes;  // shown by --help-all, before the environment
  std::span<const CommandEntry> commands;
};

// For main(): returns the exit code of the process.
int run_program(const Program& program, int argc, char** argv);

}  // namespace ubs::tools
