// SPDX-License-Identifier: Apache-2.0
// These functions make the help texts of the program: commands in groups, two examples at the top of each
// help, rarely used options only with --help-all, and suggestions for misspelt options.
#pragma once

#include <string>
#include <vector>

#include "tools/common/subcommands.hpp"

namespace ubs::tools {

// Option groups whose name starts with this text are only shown by --help-all.
inline constexpr const char* kRareGroup = "More settings";

// Must be called before subcommands are added, because they inherit the formatter and the help options that
// it sets.
void prepare_help(CLI::App& root);
// Adds a subcommand to its group, with its examples.
void explain_command(CLI::App& root, const Command& command, const CommandEntry& entry);

// Returns the complete name, such as "ubs render".
std::string full_name(const CLI::App& app);
// Returns the error message for a word that is not a subcommand. It suggests the subcommand with the most
// similar name.
std::string unknown_subcommand(const CLI::App& root, const std::string& word);

// Returns a string such as "; did you mean --cap-max?" for the first unknown option, or nothing if no option
// has a similar name.
std::string suggest_option(const CLI::App& app, const std::vector<std::string>& arguments);

}  // namespace ubs::tools
