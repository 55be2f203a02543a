// SPDX-License-Identifier: Apache-2.0
// run_program() runs a program with subcommands: `ubs` (tools/main.cpp) or `ubs-lab` (tools/lab/main.cpp).
// Every failure becomes one line on stderr and the exit code of its kind (host/base/error.hpp).
#pragma once

#include <functional>
#include <map>
#include <span>
#include <string_view>

namespace CLI {
class App;
}

namespace ubs::tools {

// Command is a subcommand. Its run() is called after the command line was parsed, and returns the exit code.
struct Command {
  CLI::App* app;
  std::function<int()> run;
};

struct CommandEntry {
  Command (*add)(CLI::App& root);              // declares the subcommand with its options
  const char* group;                           // heading in --help
  const char *first_example, *second_example;  // examples of command lines
  bool runs_on_ranks = false;                  // several processes can share its work (docs/cluster.md)
};

struct Program {
  const char *name, *description;
  std::map<int, std::string_view> exit_codes;  // those of this program in addition to 0 and kExitCodes
  std::span<const CommandEntry> commands;
};

// Called by main(). Returns the exit code of the process.
int run_program(const Program& program, int argc, char** argv);

}  // namespace ubs::tools
