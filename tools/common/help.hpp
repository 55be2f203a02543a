// SPDX-License-Identifier: Apache-2.0
// How the program explains itself: commands in groups, two examples on top of each help, what is rarely set
// only under --help-all, and what a misspelt option was probably meant to be.
#pragma once

#include <string>
#include <vector>

#include "tools/common/subcommands.hpp"

namespace ubs::tools {

// Options in a group that begins so are shown by --help-all alone.
inline constexpr const char* kRareGroup = "More settings";

// To be called before subcommands are added, which take over what it sets.
void prepare_help(CLI::App& root);
// Puts a subcommand that was added into its group, with its examples.
void explain_command(CLI::App& root, const Command& command, const CommandEntry& entry);

// "ubs render".
std::string full_name(const CLI::App& app);
// The error message for a word that is not a subcommand, with the nearest one.
std::string unknown_subcommand(const CLI::App& root, const std::string& word);

// "; did you mean --cap-max?" for the first unknown option, or nothing if no option has nearly the same
// letters.
std::string suggest_option(const CLI::App& app, const std::vector<std::string>& arguments);

}  // namespace ubs::tools
