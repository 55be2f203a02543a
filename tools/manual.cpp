// SPDX-License-Identifier: Apache-2.0
// ubs manual: manual pages and completions for bash, zsh and fish, made of the tables that parse the options.
// The build calls it (cmake/Install.cmake); the help does not show it.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/version.hpp"
#include "tools/commands.hpp"
#include "tools/help.hpp"

namespace ubs::tools {
namespace {

using Apps = std::vector<CLI::App*>;

Apps shown_commands(CLI::App& app) {
  return app.get_subcommands([](const CLI::App* part) { return !part->get_group().empty(); });
}

std::string replaced(std::string text, const std::vector<std::pair<std::string, std::string>>& pairs) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const auto found = std::ranges::find_if(
        pairs, [&](const auto& p) { return text.compare(at, p.first.size(), p.first) == 0; });
    out += found == pairs.end() ? std::string(1, text[at]) : found->second;
    at += found == pairs.end() ? 1 : found->first.size();
  }
  return out;
}

// As text of a page: a line that begins with a full stop or a quote would be a request.
std::string roff(const std::string& text) {
  std::string out = replaced(text, {{"\\", "\\e"}, {"-", "\\-"}, {"\n.", "\n\\&."}, {"\n'", "\n\\&'"}});
  return out.starts_with('.') || out.starts_with('\'') ? "\\&" + out : out;
}

std::vector<const CLI::Option*> options_of(const CLI::App& app, const std::string& group) {
  return app.get_options([&](const CLI::Option* option) { return option->get_group() == group; });
}

std::string page_name(const CLI::App& app) { return replaced(full_name(app), {{" ", "-"}}); }

std::string page_of(CLI::App& app) {
  const Apps commands = shown_commands(app);
  const std::string name = page_name(app);
  std::string upper = name;
  std::ranges::transform(upper, upper.begin(),
                         [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  std::string page = fmt::format(".TH {} 1 \"\" \"ubs {}\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n.B {}\n",
                                 upper, roff(name), roff(app.get_description()), version(), full_name(app));
  page += commands.empty() ? "[options]" : app.get_parent() ? "[command] [options]" : "command [options]";
  for (const CLI::Option* option : app.get_options())
    if (option->get_positional()) page += " " + roff(option->get_name(true, false));
  page += "\n";
  if (!commands.empty()) page += ".SH COMMANDS\n";
  for (const CLI::App* command : commands)
    page += fmt::format(".TP\n.BR {} (1)\n{}\n", roff(page_name(*command)), roff(command->get_description()));
  for (const std::string& group : app.get_groups()) {
    const auto options = options_of(app, group);
    if (group.empty() || options.empty()) continue;
    page += fmt::format(".SH \"{}\"\n", roff(group));
    for (const CLI::Option* option : options)
      page += fmt::format(".TP\n.B {} {}\n{}\n", roff(option->get_name(false, true)),
                          roff(option->get_type_name()), roff(option->get_description()));
  }
  if (!app.get_footer().empty()) page += ".SH NOTES\n" + roff(app.get_footer()) + "\n";
  return page;
}

std::vector<std::string> flags_of(CLI::App& app) {
  std::vector<std::string> flags;
  for (CLI::App* part : shown_commands(app)) flags = flags_of(*part);
  for (const CLI::Option* option : app.get_options())
    for (const std::string& name : option->get_lnames()) flags.push_back("--" + name);
  return flags;
}

std::string names_of(const Apps& commands) {
  std::vector<std::string> names;
  for (const CLI::App* command : commands) names.push_back(command->get_name());
  return fmt::format("{}", fmt::join(names, " "));
}

// A word that begins with a minus is an option, any other a file. zsh takes the same function.
std::string bash_of(const Apps& commands) {
  std::string text =
      "_ubs() {\n  local word=${COMP_WORDS[COMP_CWORD]} words parts=\n  if [ \"$COMP_CWORD\" -eq 1 ]; then\n "
      "   "
      "words=\"" +
      names_of(commands) + " --help --help-all --version\"\n  else\n    case ${COMP_WORDS[1]} in\n";
  for (CLI::App* command : commands)
    text += fmt::format("      {}) words=\"{}\" parts=\"{}\" ;;\n", command->get_name(),
                        fmt::join(flags_of(*command), " "), names_of(shown_commands(*command)));
  return text +
         "    esac\n    case $word in -*) ;; *) words= ;; esac\n"
         "    [ \"$COMP_CWORD\" -eq 2 ] && words=\"$words $parts\"\n  fi\n"
         "  COMPREPLY=($(compgen -W \"$words\" -- \"$word\"))\n}\ncomplete -o default -F _ubs ubs\n";
}

std::string fish_of(const Apps& commands, const std::string& where = "__fish_use_subcommand") {
  const auto quoted = [](const std::string& text) {
    return fmt::format("'{}'", replaced(text, {{"\\", "\\\\"}, {"'", "\\'"}, {"\n", " "}}));
  };
  std::string text;
  for (CLI::App* command : commands) {
    text += fmt::format("complete -c ubs -n '{}' -f -a {} -d {}\n", where, command->get_name(),
                        quoted(command->get_description()));
    text += fish_of(shown_commands(*command), "__fish_seen_subcommand_from " + command->get_name());
    for (const CLI::Option* option : command->get_options())
      for (const std::string& name : option->get_lnames())
        text += fmt::format("complete -c ubs -n '__fish_seen_subcommand_from {}' -l {} -d {}\n",
                            command->get_name(), name, quoted(option->get_description()));
  }
  return text;
}

int run(CLI::App& root, const std::string& folder) {
  const std::filesystem::path out = folder;
  const auto write = [&](const std::string& name, const std::string& text) {
    const std::filesystem::path path = out / name;
    make_folders(path.parent_path());
    write_file_atomically(path, text);
  };
  const auto write_pages = [&](CLI::App& app, const auto& again) -> void {
    write(fmt::format("man1/{}.1", page_name(app)), page_of(app));
    for (CLI::App* part : shown_commands(app)) again(*part, again);
  };
  write_pages(root, write_pages);
  const Apps commands = shown_commands(root);
  const std::string bash = bash_of(commands);
  write("bash-completion/completions/ubs", bash);
  write("zsh/site-functions/_ubs", "#compdef ubs\nautoload -U +X bashcompinit && bashcompinit\n" + bash +
                                       "_bash_complete -o default -F _ubs\n");
  write("fish/vendor_completions.d/ubs.fish", fish_of(commands));
  return 0;
}

}  // namespace

Command add_manual(CLI::App& root) {
  CLI::App* app = root.add_subcommand("manual", "Write manual pages and completions for shells");
  const auto folder = std::make_shared<std::string>();
  app->group("");
  app->add_option("out", *folder, "folder")->required();
  return {app, [&root, folder] { return run(root, *folder); }};
}

}  // namespace ubs::tools
