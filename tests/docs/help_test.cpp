// SPDX-License-Identifier: Apache-2.0
// Tests the lists of the README that are generated from the help texts (generated_list.hpp): commands and
// exit codes. Also tests that the README mentions the commands of ubs-lab, and that the help texts list all
// environment variables.
#include <catch2/catch.hpp>
#include <filesystem>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/support/generated_list.hpp"
#include "tests/support/run_ubs.hpp"

using namespace ubs::test;

namespace {

namespace fs = std::filesystem;

const fs::path kRoot = UBS_SOURCE_DIR;

std::string help_of(const char* program) {
  const TempFolder folder;
  const Result result = run_command(folder, quoted(program) + " --help-all");
  REQUIRE(result.code == 0);
  return result.out;
}

// Returns all groups of every match of the pattern.
std::vector<std::vector<std::string>> found_in(const std::string& text, const char* pattern) {
  const std::regex regex(pattern);
  std::vector<std::vector<std::string>> found;
  for (std::sregex_iterator match(text.begin(), text.end(), regex), end; match != end; ++match)
    found.emplace_back(std::next(match->begin()), match->end());
  return found;
}

// In the help texts, a line with the name of a command and its purpose is followed by a line with an example.
const char* const kCommand = "\n  ([a-z]+)  +([^\n]+)\n  +(ubs[^\n]+)";

}  // namespace

TEST_CASE("help: the README has the lists of commands and exit codes", "[docs]") {
  const std::string help = help_of(UBS_EXECUTABLE);
  std::string commands = table_head({"example", "purpose"});
  for (const std::vector<std::string>& command : found_in(help, kCommand))
    commands += table_row({backticks(command[2]), command[1]});
  check_list("README.md", "commands", commands);

  std::string codes = table_head({"exit code", "meaning"});
  for (const std::vector<std::string>& code : found_in(help, "\n  ([0-9]+)  +([^\n]+)"))
    codes += table_row({code[0], code[1]});
  check_list("README.md", "exit codes", codes);
}

TEST_CASE("help: the README mentions all commands of ubs-lab", "[docs]") {
  const std::string readme = ubs::read_text_file(kRoot / "README.md");
  const auto commands = found_in(help_of(UBS_LAB_EXECUTABLE), kCommand);
  CHECK(commands.size() > 5);
  for (const std::vector<std::string>& command : commands) {
    INFO(command[0]);
    CHECK(readme.find(backticks("ubs-lab " + command[0])) != std::string::npos);
  }
}

TEST_CASE("help: the help texts list all environment variables", "[docs]") {
  std::set<std::string> used, listed;
  for (const char* folder : {"host", "tools", "cuda_backend"})
    for (const auto& entry : fs::recursive_directory_iterator(kRoot / folder))
      if (const auto extension = entry.path().extension(); extension == ".cpp" || extension == ".cu")
        for (const std::vector<std::string>& name :
             found_in(ubs::read_text_file(entry.path()),
                      R"re((?:getenv|environment|environment_flag|cache_folder)\("(UBS_[A-Z_]+)"\))re"))
          used.insert(name[0]);
  for (const std::vector<std::string>& name : found_in(help_of(UBS_EXECUTABLE), "\n  (UBS_[A-Z_]+)  +"))
    listed.insert(name[0]);
  CHECK(used == listed);
}
