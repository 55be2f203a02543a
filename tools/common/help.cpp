// SPDX-License-Identifier: Apache-2.0
#include "tools/common/help.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <map>
#include <memory>
#include <sstream>
#include <utility>

#include "host/base/error.hpp"
#include "host/base/text.hpp"

namespace ubs::tools {
namespace {

bool rare(const std::string& group) { return group.starts_with(kRareGroup); }

class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter() { column_width(26); }

  void know(const std::string& command, const CommandEntry& entry) { entries_[command] = entry; }

  std::string make_usage(const CLI::App* app, std::string name) const override {
    std::string text = CLI::Formatter::make_usage(app, name);
    if (const CommandEntry* e = entry_of(*app))
      text += fmt::format("\nExamples:\n  {}\n  {}\n", e->first_example, e->second_example);
    return text;
  }

  // Options that are shown among the positionals are not repeated. Rare groups and the footer are only shown
  // with --help-all.
  std::string option_groups(const CLI::App* app, CLI::AppFormatMode mode) const {
    std::ostringstream out;
    std::size_t left_out = 0;
    for (const std::string& group : app->get_groups()) {
      std::vector<const CLI::Option*> options = app->get_options([&](const CLI::Option* option) {
        return option->get_group() == group && option->nonpositional() && !option->get_positional();
      });
      if (group.empty() || options.empty()) continue;
      if (rare(group) && mode == CLI::AppFormatMode::Normal)
        left_out += options.size();
      else
        out << make_group(group, false, options);
    }
    if (left_out > 0) out << "\n" << left_out << " more options: " << full_name(*app) << " --help-all\n";
    return out.str();
  }

  std::string make_option_name(const CLI::Option* option, bool positional) const override {
    std::string name = CLI::Formatter::make_option_name(option, positional);
    if (positional && !option->get_lnames().empty()) name += ", --" + option->get_lnames().front();
    return name;
  }

  std::string make_option_usage(const CLI::Option* option) const override {
    const std::string name = CLI::Formatter::make_option_name(option, true);
    return option->get_required() ? name : "[" + name + "]";
  }

  std::string make_subcommand(const CLI::App* sub) const override {
    const CommandEntry* e = entry_of(*sub);
    return CLI::Formatter::make_subcommand(sub) +
           (e ? fmt::format("{:{}}  {}\n", "", column_width_, e->first_example) : "");
  }

  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    std::ostringstream out;
    out << make_description(app) << make_usage(app, name) << make_positionals(app);
    const bool root = !app->get_parent();
    if (!root || mode == CLI::AppFormatMode::All) out << option_groups(app, mode);
    out << make_subcommands(app, CLI::AppFormatMode::Normal);
    if (root)
      out << fmt::format(
          "\n{0} COMMAND --help explains a command, {0} --help-all lists exit codes and environment "
          "variables.\n",
          app->get_name());
    if (mode == CLI::AppFormatMode::All) out << make_footer(app);
    return out.str();
  }

 private:
  const CommandEntry* entry_of(const CLI::App& app) const {
    const auto found = entries_.find(app.get_name());
    return app.get_parent() && found != entries_.end() ? &found->second : nullptr;
  }
  std::map<std::string, CommandEntry> entries_;  // by command name
};

}  // namespace

std::string full_name(const CLI::App& app) {
  return app.get_parent() ? full_name(*app.get_parent()) + " " + app.get_name() : app.get_name();
}

std::string unknown_subcommand(const CLI::App& root, const std::string& word) {
  std::vector<std::string> known;
  for (const CLI::App* app : root.get_subcommands([](const CLI::App* a) { return !a->get_group().empty(); }))
    known.push_back(app->get_name());
  const std::string nearest = nearest_word(word, known);
  return fmt::format("unknown subcommand '{}'; {}", word,
                     nearest.empty() ? fmt::format("there are: {}", fmt::join(known, ", "))
                                     : fmt::format("did you mean '{}'?", nearest));
}

void prepare_help(CLI::App& root) {
  root.formatter(std::make_shared<HelpFormatter>());
  root.set_help_flag("-h,--help", "print this help");
  root.set_help_all_flag("--help-all", "print all options, exit codes and environment variables");
}

void explain_command(CLI::App& root, const Command& command, const CommandEntry& entry) {
  command.app->group(entry.group);
  dynamic_cast<HelpFormatter&>(*root.get_formatter()).know(command.app->get_name(), entry);
}

namespace {

// An option of another trainer, the option of ubs that has this meaning, and what it is.
struct OtherOption {
  std::string_view theirs, ours, meaning;
};
constexpr OtherOption kOtherOptions[] = {
    {"-s", "data", "the data folder"},
    {"--source_path", "data", "the data folder"},
    {"--source-path", "data", "the data folder"},
    {"--data_dir", "data", "the data folder"},
    {"--data-path", "data", "the data folder"},
    {"-d", "data", "the data folder"},
    {"-m", "model", "the model"},
    {"--model_path", "model", "the model"},
    {"--model-path", "model", "the model"},
    {"-m", "out", "the output folder"},
    {"--model_path", "out", "the output folder"},
    {"--model-path", "out", "the output folder"},
    {"-o", "out", "the output"},
    {"--output", "out", "the output"},
    {"--result_dir", "out", "the output folder"},
    {"--output-path", "out", "the output folder"},
    {"-r", "downscale", "the factor that reduces the images"},
    {"--resolution", "downscale", "the factor that reduces the images"},
    {"--data_factor", "downscale", "the factor that reduces the images"},
    {"--downscale-factor", "downscale", "the factor that reduces the images"},
    {"--eval", "test-every", "8 makes every 8th view a test view"},
    {"--test_every", "test-every", "every n-th view is a test view"},
    {"--steps", "iterations", "the number of iterations"},
    {"--max_steps", "iterations", "the number of iterations"},
    {"--max-steps", "iterations", "the number of iterations"},
    {"--num-iters", "iterations", "the number of iterations"},
    {"--max-num-iterations", "iterations", "the number of iterations"},
    {"--total-steps", "iterations", "the number of iterations"},
    {"-i", "iterations", "the number of iterations"},
    {"--max-cap", "cap-max", "the maximum number of splats"},
    {"--cap_max", "cap-max", "the maximum number of splats"},
    {"--sh_degree", "degree", "the degree of the spherical harmonics"},
    {"--white_background", "background", "1,1,1 is white"},
    {"-w", "background", "1,1,1 is white"},
};

}  // namespace

std::string suggest_option(const CLI::App& app, const std::vector<std::string>& arguments) {
  std::vector<std::string> known;
  for (const CLI::Option* option : app.get_options())
    for (const std::string& name : option->get_lnames()) known.push_back(name);
  for (const std::string& argument : arguments) {
    const std::string name = argument.substr(0, argument.find('='));
    if (app.get_option_no_throw(name)) continue;
    for (const OtherOption& other : kOtherOptions)
      if (name == other.theirs && std::ranges::find(known, other.ours) != known.end())
        return fmt::format("; did you mean --{} ({})?", other.ours, other.meaning);
    if (!argument.starts_with("--")) continue;
    if (std::ranges::find(known, name.substr(2)) != known.end()) continue;
    const std::string nearest = nearest_word(name.substr(2), known);
    if (!nearest.empty()) return fmt::format("; did you mean --{}?", nearest);
  }
  return "";
}

}  // namespace ubs::tools
