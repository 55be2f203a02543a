// SPDX-License-Identifier: Apache-2.0
// ubs-lab stress: runs difficult, extreme and random cases and compares their results with float64. The cases
// are Catch2 test cases (tests/stress/run_stress.hpp), so Catch2 parses the command line.
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tests/stress/run_stress.hpp"
#include "tools/lab/lab_commands.hpp"

namespace ubs::tools {

Command add_stress(CLI::App& root) {
  CLI::App* app = root.add_subcommand(
      "stress",
      "Compare the results of difficult, extreme and random cases with float64 results (docs/stability.md)");
  app->set_help_flag();  // Catch2 has its own help
  app->set_help_all_flag();
  app->prefix_command();
  return {app, [app] {
            std::vector<std::string> words{"ubs-lab stress"};
            for (const std::string& word : app->remaining())
              words.push_back(word == "--help-all" ? "--help" : word);
            std::vector<char*> argv;
            for (std::string& word : words) argv.push_back(word.data());
            return stress::run_stress(static_cast<int>(argv.size()), argv.data());
          }};
}

}  // namespace ubs::tools
