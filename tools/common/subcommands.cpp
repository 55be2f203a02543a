// SPDX-License-Identifier: Apache-2.0
#include "tools/common/subcommands.hpp"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/text.hpp"
#include "host/base/warning.hpp"
#include "host/device/registry.hpp"
#include "host/settings/fields.hpp"
#include "tools/common/help.hpp"
#include "tools/common/job.hpp"
#include "tools/common/program_version.hpp"
#include "tools/common/streams.hpp"

namespace ubs::tools {
namespace {

// Environment variables and their meanings. tests/docs/help_test.cpp tests that none is missing.
constexpr std::pair<std::string_view, std::string_view> kVariables[] = {
    {"UBS_DEVICE", "as --device"},
    {"UBS_KERNEL_DIR", "kernel sources from disk"},
    {"UBS_KERNEL_CACHE", "folder of compiled kernels, including PoCL's; off: do not store them"},
    {"UBS_SYNC", "1: wait after every kernel, and name the one that fails"},
    {"UBS_CHECK", "off: also use devices that were not checked or failed the check (docs/check.md)"},
    {"UBS_TUNING", "off: ignore values that `ubs-lab tune` stored"},
    {"UBS_TUNING_DIR", "folder of these values"},
    {"UBS_HUGE_PAGES", "0: use ordinary pages for buffers of CPU devices"},
    {"UBS_RANK_PATIENCE", "seconds that a rank of a job waits for the others (docs/cluster.md)"},
    {"UBS_LPIPS_WEIGHTS", "as --lpips-weights"},
};

const Program* running = nullptr;  // set once by run_program()

// Returns the exit codes of the program and the environment variables, with their meanings, one per line.
std::string footer(const Program& program) {
  std::map<int, std::string_view> codes = program.exit_codes;
  codes.emplace(0, "success");
  for (const ExitCode& row : kExitCodes) codes.emplace(row.code, row.meaning);
  std::string text = "\nExit codes:\n";
  for (const auto& [code, meaning] : codes) text += fmt::format("  {:<24}{}\n", code, meaning);
  text += "\nEnvironment variables:\n";
  for (const auto& [name, meaning] : kVariables) text += fmt::format("  {:<24}{}\n", name, meaning);
  text.pop_back();
  return text;
}

int report(std::string message, int code) {
  std::replace(message.begin(), message.end(), '\n', ' ');
  message = fmt::format("{}: error: {}{}\n", running->name, error_prefix(),
                        encode_text(message));  // names may contain any bytes
  std::cerr << message << std::flush;           // in one write, because other ranks share stderr
  return end_with_error(code);
}

int report_parse_error(const CLI::ParseError& error, const CLI::App& root,
                       const std::vector<std::string>& arguments) {
  const int code = exit_code(ErrorKind::usage);
  const auto used = root.get_subcommands();
  if (used.empty() && !arguments.empty() && !arguments.front().starts_with('-'))
    return report(unknown_subcommand(root, arguments.front()), code);
  const CLI::App* app = used.empty() ? &root : used.front();
  const bool unknown = dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr;
  return report(fmt::format("{}{} (see '{} --help')", error.what(),
                            unknown ? suggest_option(*app, arguments) : "", full_name(*app)),
                code);
}

// Converts "help" and "help train" to "--help" and "train --help".
std::vector<std::string> words_of_help(std::vector<std::string> arguments) {
  arguments.erase(arguments.begin());
  arguments.emplace_back("--help");
  return arguments;
}

// Throws if several ranks run a command that does not support this: each rank would do all its work and write
// all its files.
void check_ranks(const CLI::App& command, const CommandEntry& entry) {
  if (ranks().size() > 1 && !entry.runs_on_ranks)
    fail(ErrorKind::usage, "'{}' only runs in a single process: start it without mpirun", full_name(command));
}

int run(int argc, char** argv) {
  join();
  CLI::App root(running->description, running->name);
  root.set_version_flag("--version", version_line(running->name));
  root.footer(footer(*running));
  root.require_subcommand(1);
  prepare_help(root);
  std::vector<Command> commands;
  for (const CommandEntry& entry : running->commands) {
    commands.push_back(entry.add(root));
    explain_command(root, commands.back(), entry);
  }
  // Each option takes one word, in which commas separate the items of a list. So the words after it are
  // folders or models.
  for (const Command& command : commands)
    for (CLI::Option* option : command.app->get_options()) {
      if (option->get_positional()) continue;
      option->allow_extra_args(false);
      if (option->get_delimiter() != '\0')
        option->expected(1)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)->allow_extra_args(false);
    }
  if (argc == 1) {
    say("{}", root.help());
    return 0;
  }
  std::vector<std::string> arguments(argv + 1, argv + argc);
  const auto is_command = [&](const std::string& word) {
    return std::ranges::any_of(commands, [&](const Command& c) { return c.app->get_name() == word; });
  };
  if (arguments.front() == "help") {
    arguments = words_of_help(arguments);
    if (arguments.size() > 1 && !is_command(arguments.front()))
      return report(unknown_subcommand(root, arguments.front()), exit_code(ErrorKind::usage));
  }
  try {
    root.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return root.exit(error);  // --help, --version
    return report_parse_error(error, root, arguments);
  }
  for (std::size_t i = 0; i < commands.size(); ++i)
    if (commands[i].app->parsed()) {
      check_ranks(*commands[i].app, running->commands[i]);
      return commands[i].run();
    }
  fail(ErrorKind::internal, "no subcommand was run");
}

int run_reporting_errors(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const ReaderGone&) {
    return exit_code(ErrorKind::data);
  } catch (const std::exception& exception) {
    const Error error = as_error(exception);
    return report(error.what(), exit_code(error.kind()));
  }
}

void log_to_stderr(LogLevel level, const std::string& text) {
  if (!ranks().first()) return;  // the first rank logs the same
  if (level == LogLevel::warning)
    remark("{}: warning: {}\n", running->name, encode_text(text));
  else if (isatty(STDERR_FILENO) == 1)
    remark("{}: {}\n", running->name, encode_text(text));
}

// Only the executable changes the environment, because the library may run in a process with other code.
// Variables that the user has set are kept.
void prepare_environment() {
  keep_driver_caches([](const char* name, const char* value) { setenv(name, value, 1); });
  // The parent may have ignored this signal. Then the exit codes of child processes would be lost.
  std::signal(SIGCHLD, SIG_DFL);
}

}  // namespace

int run_program(const Program& program, int argc, char** argv) {
  running = &program;
  prepare_environment();
  prepare_streams();
  set_log(log_to_stderr);
  std::string complaint;
  const int code = finish_streams(run_reporting_errors(argc, argv), complaint);
  if (!complaint.empty()) return report(complaint, code);
  leave();
  return code;
}

}  // namespace ubs::tools
