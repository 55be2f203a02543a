// SPDX-License-Identifier: Apache-2.0
// check_list() tests a list in a document that is generated from a table of the code. The list is between the
// comments "<!-- list of NAME -->" and "<!-- end of the list -->". With the environment variable
// UBS_WRITE_LISTS=1, check_list() writes the list into the document instead.
#pragma once

#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <initializer_list>
#include <string>

#include "host/base/file.hpp"

namespace ubs::test {

// Returns a row of a Markdown table.
inline std::string table_row(std::initializer_list<std::string> cells) {
  std::string row = "|";
  for (std::string cell : cells) {
    for (std::size_t at = 0; (at = cell.find('|', at)) != std::string::npos; at += 2) cell.insert(at, "\\");
    row += cell.empty() ? " |" : " " + cell + " |";
  }
  return row + "\n";
}

// Returns the two lines above the rows of a Markdown table.
inline std::string table_head(std::initializer_list<std::string> headings) {
  std::string line = "|";
  for (std::size_t i = 0; i < headings.size(); ++i) line += "---|";
  return table_row(headings) + line + "\n";
}

inline std::string backticks(std::string_view text) { return "`" + std::string(text) + "`"; }

// `page` is a path from the root of the project.
inline void check_list(const char* page, const std::string& name, const std::string& expected) {
  const std::filesystem::path path = std::filesystem::path(UBS_SOURCE_DIR) / page;
  std::string text = read_text_file(path);
  const std::string begin = "<!-- list of " + name + " -->\n", end = "<!-- end of the list -->\n";
  INFO(page << ": list of " << name << ": to write the list again, repeat this test with UBS_WRITE_LISTS=1");
  std::size_t first = text.find(begin);
  REQUIRE(first != std::string::npos);
  first += begin.size();
  const std::size_t last = text.find(end, first);
  REQUIRE(last != std::string::npos);
  if (std::getenv("UBS_WRITE_LISTS")) {
    text.replace(first, last - first, expected);
    write_file_atomically(path, text);
  } else {
    CHECK(text.substr(first, last - first) == expected);
  }
}

}  // namespace ubs::test
