// SPDX-License-Identifier: Apache-2.0
// Tests that documents, help texts and interfaces list what the tables of the code contain: layouts, formats,
// camera models, variants, exit codes, commands and environment variables. The lists of commands and of
// environment variables may contain further entries; the others must be equal to the tables.
#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/data/lens.hpp"
#include "host/data/load_dataset.hpp"
#include "host/data/splat_file.hpp"
#include "host/scene/model_variant.hpp"

namespace {

namespace fs = std::filesystem;
using Texts = std::vector<std::string>;

const fs::path kRoot = UBS_SOURCE_DIR;

std::string source(const char* name) { return ubs::read_text_file(kRoot / name); }

// Returns the first group of every match of the pattern.
Texts found_in(const std::string& text, const char* pattern) {
  const std::regex regex(pattern);
  return {std::sregex_token_iterator(text.begin(), text.end(), regex, 1), std::sregex_token_iterator()};
}

std::set<std::string> set_of(const Texts& texts) { return {texts.begin(), texts.end()}; }

// Returns the part of the text between `begin` and `end`. The text must contain both.
std::string between(const std::string& text, std::string_view begin, std::string_view end) {
  const std::size_t first = text.find(begin);
  REQUIRE(first != std::string::npos);
  const std::size_t last = text.find(end, first + begin.size());
  REQUIRE(last != std::string::npos);
  return text.substr(first + begin.size(), last - first - begin.size());
}

// Returns the rows of the Markdown table whose first line starts with `head`, without its two header lines.
std::vector<Texts> table_of(const char* page, std::string_view head) {
  std::ifstream file(kRoot / page);
  std::vector<Texts> rows;
  bool inside = false;
  for (std::string line; std::getline(file, line);) {
    if (inside && !line.starts_with("|")) break;
    if (inside && !line.starts_with("|---")) rows.push_back(found_in(line, R"(\| *([^|]*[^| ])? *(?=\|))"));
    inside = inside || line.starts_with(head);
  }
  return rows;
}

// Returns the words between backticks. "`sh0` to `sh3`" stands for sh0, sh1, sh2, sh3.
std::set<std::string> quoted_words(const std::string& text) {
  std::set<std::string> words;
  const std::regex quoted("( to )?`([^`]*)`");
  std::string before;
  for (std::sregex_iterator match(text.begin(), text.end(), quoted), end; match != end; ++match) {
    const std::string word = (*match)[2];
    if ((*match)[1].matched)
      for (char digit = before.back(); digit < word.back(); ++digit)
        words.insert(word.substr(0, word.size() - 1) + digit);
    words.insert(before = word);
  }
  return words;
}

std::set<std::string> exit_codes() {
  std::set<std::string> codes;
  for (int kind = 0; kind <= static_cast<int>(ubs::ErrorKind::internal); ++kind)
    codes.insert(std::to_string(ubs::exit_code(static_cast<ubs::ErrorKind>(kind))));
  return codes;
}

}  // namespace

TEST_CASE("tables: docs/data.md lists the layouts, formats and camera models of the code", "[docs]") {
  Texts layouts;
  for (const Texts& row : table_of("docs/data.md", "| layout |")) layouts.push_back(row.at(0));
  Texts expected;
  for (const std::string_view name : ubs::layout_names()) expected.push_back("`" + std::string(name) + "`");
  CHECK(layouts == expected);

  Texts written;
  for (const Texts& row : table_of("docs/data.md", "| format | recognised by |"))
    for (std::string& name : found_in(row.at(3), "--to ([a-z0-9]+)")) written.push_back(std::move(name));
  CHECK(set_of(written) == set_of(ubs::written_formats()));

  std::vector<Texts> lenses;
  for (const ubs::LensModel& model : ubs::lens_models()) {
    std::string names(model.name);
    for (const std::string_view alias : ubs::words_of(model.json_aliases)) names += ", " + std::string(alias);
    const auto own = ubs::words_of(model.parameters);
    std::string extra;
    for (const std::string_view word : ubs::words_of(model.json_extra))
      if (std::ranges::count(own, word) == 0) extra += (extra.empty() ? "" : " ") + std::string(word);
    lenses.push_back({std::to_string(model.number), names, std::string(model.parameters), extra});
  }
  CHECK(table_of("docs/data.md", "| number | name |") == lenses);
}

TEST_CASE("tables: docs/variants.md lists the settings of a variant and their values", "[docs]") {
  const std::vector<Texts> rows = table_of("docs/variants.md", "| setting | values");
  REQUIRE(rows.size() == ubs::kVariantSwitches.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const ubs::VariantSwitch& row = ubs::kVariantSwitches[i];
    CHECK(rows[i].at(0) == "`" + std::string(row.key) + "`");
    std::set<std::string> values = quoted_words(rows[i].at(1));
    values.erase("auto");  // a value of the setting, but not of the variant
    CHECK(values == set_of(found_in(row.values, "([a-z0-9_]+)")));
  }
}

TEST_CASE("tables: the exit codes are the same in documents, help, headers and the Python package",
          "[docs]") {
  const std::set<std::string> codes = exit_codes();
  CHECK(set_of(found_in(source("host/base/error.hpp"), "exit ([0-9]+)\n")) == codes);
  CHECK(set_of(found_in(source("python/ubs/_errors.py"), "\n    ([0-9]+): [A-Z]")) == codes);
  std::set<std::string> all = codes;
  all.insert("0");
  CHECK(set_of(found_in(source("include/ubs/ubs.h"), "UBS_(?:OK|ERROR_[A-Z]+) = ([0-9]+)")) == all);
  all.insert("130");
  const char* number = "\\b([0-9]+)\\b";
  CHECK(set_of(found_in(between(source("README.md"), "The exit codes are:", "\n\n"), number)) == all);
  CHECK(set_of(found_in(between(source("tools/main.cpp"), "Exit codes:", ";"), number)) == all);
}

TEST_CASE("tables: the README lists all commands, and the help lists all environment variables", "[docs]") {
  const std::string readme = source("README.md");
  for (const auto& [file, program] :
       {std::pair{"tools/main.cpp", ""}, std::pair{"tools/lab/main.cpp", "ubs-lab "}}) {
    const Texts commands = found_in(source(file), "\\{add_([a-z]+),");
    CHECK(commands.size() > 5);
    for (const std::string& command : commands) {
      INFO(command);
      CHECK(readme.find("`" + std::string(program) + command + "`") != std::string::npos);
    }
  }
  const std::string help = between(source("tools/common/subcommands.cpp"), "\"Environment: ", ";\n");
  std::set<std::string> variables;
  for (const char* folder : {"host", "tools", "cuda_backend"})
    for (const auto& entry : fs::recursive_directory_iterator(kRoot / folder))
      if (const auto extension = entry.path().extension(); extension == ".cpp" || extension == ".cu")
        variables.merge(set_of(
            found_in(ubs::read_text_file(entry.path()),
                     R"re((?:getenv|environment|environment_flag|cache_folder)\("(UBS_[A-Z_]+)"\))re")));
  CHECK(variables.size() > 8);
  for (const std::string& variable : variables) {
    INFO(variable);
    CHECK(help.find(variable) != std::string::npos);
  }
}
