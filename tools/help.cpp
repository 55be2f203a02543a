// SPDX-License-Identifier: Apache-2.0
#include "tools/help.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <sstream>
#include <utility>

#include "host/base/error.hpp"
#include "host/spec/settings.hpp"

namespace ubs::tools {
namespace {

struct Examples {
  const char *command, *group, *first, *second;
};

constexpr const char *kLearn = "Learn", *kLook = "Look", *kConvert = "Convert", *kMeasure = "Measure",
                     *kDevices = "Devices";

constexpr Examples kExamples[] = {
    {"cameras", kLearn, "ubs cameras photos", "ubs cameras photos --order sequence"},
    {"train", kLearn, "ubs train photos", "ubs train photos --out run --budget 10m"},
    {"plan", kLearn, "ubs plan photos", "ubs plan photos --dim 7 --iterations 10000"},
    {"reduce", kLearn, "ubs reduce run --out small.ply",
     "ubs reduce run photos --max-loss-db 0.2 --out small.ply"},
    {"view", kLook, "ubs view run", "ubs view run photos"},
    {"render", kLook, "ubs render run --video flight.mp4",
     "ubs render run photos --split test --out pictures"},
    {"report", kLook, "ubs report run", "ubs report run other --out both.html"},
    {"web", kLook, "ubs web run --out model.html", "ubs web run photos --out model.ubsz"},
    {"eval", kLook, "ubs eval run", "ubs eval scan.ply photos --lpips alex --json"},
    {"metrics", kLook, "ubs metrics truth.png render.png", "ubs metrics truths renders --out metrics.json"},
    {"info", kLook, "ubs info run", "ubs info photos --json"},
    {"convert", kConvert, "ubs convert scan.spz scan.ply --to ubs", "ubs convert run scene.ply --to 3dgs"},
    {"pack", kConvert, "ubs pack photos --out photos.ubsd", "ubs pack photos --downscale 2 --out half.ubsd"},
    {"synth", kConvert, "ubs synth glossy --out data", "ubs synth orbit --out data --size 200"},
    {"bench", kMeasure, "ubs bench --quick", "ubs bench run photos --run iteration"},
    {"accuracy", kMeasure, "ubs accuracy --out accuracy", "ubs accuracy run photos --out accuracy"},
    {"gradients", kMeasure, "ubs gradients run photos --view 0 --out gradients.ply",
     "ubs gradients run photos --view 3 --split train --out gradients.ply"},
    {"devices", kDevices, "ubs devices --doctor", "ubs devices --check --device gpu --dim 6"},
    {"compare", kDevices, "ubs compare --devices cpu,gpu run photos",
     "ubs compare --devices cpu,cuda run photos --train-iterations 100"},
    {"tune", kDevices, "ubs tune", "ubs tune --device gpu --max-time 120"},
};

const Examples* examples_of(const std::string& command) {
  const auto found = std::ranges::find_if(kExamples, [&](const Examples& e) { return command == e.command; });
  return found == std::end(kExamples) ? nullptr : &*found;
}

bool rare(const std::string& group) { return group.starts_with(kRareGroup); }

class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter() { column_width(26); }

  std::string make_usage(const CLI::App* app, std::string name) const override {
    std::string text = CLI::Formatter::make_usage(app, name);
    if (const Examples* e = examples_of(app->get_name()); e && app->get_parent())
      text += std::string("\nExamples:\n  ") + e->first + "\n  " + e->second + "\n";
    return text;
  }

  // What is shown among the positionals is not repeated; rare groups are, and the foot, with --help-all.
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
    const Examples* e = examples_of(sub->get_name());
    return CLI::Formatter::make_subcommand(sub) +
           (e ? std::string(column_width_, ' ') + "  " + e->first + "\n" : "");
  }

  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    std::ostringstream out;
    out << make_description(app) << make_usage(app, name) << make_positionals(app);
    const bool root = !app->get_parent();
    if (!root || mode == CLI::AppFormatMode::All) out << option_groups(app, mode);
    out << make_subcommands(app, CLI::AppFormatMode::Normal);
    if (root) {
      out << "\nubs COMMAND --help explains a command, ubs --help-all exit codes and environment.\n";
    }
    if (mode == CLI::AppFormatMode::All) out << make_footer(app);
    return out.str();
  }
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
  root.set_help_all_flag("--help-all", "print all options, exit codes and the environment");
}

void arrange_commands(CLI::App& root) {
  for (CLI::App* command : root.get_subcommands([](const CLI::App*) { return true; })) {
    if (command->get_group().empty()) continue;  // not for people
    const Examples* e = examples_of(command->get_name());
    if (!e) fail(ErrorKind::internal, "'{}' has no example", command->get_name());
    command->group(e->group);
  }
}

std::string suggest_option(const CLI::App& app, const std::vector<std::string>& arguments) {
  std::vector<std::string> known;
  for (const CLI::Option* option : app.get_options())
    for (const std::string& name : option->get_lnames()) known.push_back(name);
  for (const std::string& argument : arguments) {
    if (!argument.starts_with("--")) continue;
    const std::string name = argument.substr(0, argument.find('='));
    if (std::ranges::find(known, name.substr(2)) != known.end()) continue;
    const std::string nearest = nearest_word(name.substr(2), known);
    if (!nearest.empty()) return fmt::format("; did you mean --{}?", nearest);
  }
  return "";
}

}  // namespace ubs::tools
