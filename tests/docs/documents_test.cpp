// SPDX-License-Identifier: Apache-2.0
// The documents are part of the program: every section of docs/method.md that a comment cites exists, and
// every link between the documents leads somewhere.
#include <catch2/catch.hpp>
#include <filesystem>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "host/base/file.hpp"

namespace {

namespace fs = std::filesystem;

const fs::path kSource = UBS_SOURCE_DIR;

std::vector<fs::path> files_below(std::initializer_list<const char*> folders,
                                  const std::set<std::string>& extensions) {
  std::vector<fs::path> found;
  for (const char* folder : folders)
    for (const auto& entry : fs::recursive_directory_iterator(kSource / folder))
      if (entry.is_regular_file() && extensions.contains(entry.path().extension().string()))
        found.push_back(entry.path());
  return found;
}

// What group `group` of the pattern matched, at every place of the text.
std::vector<std::string> matches(const std::string& text, const std::regex& pattern, int group) {
  return {std::sregex_token_iterator(text.begin(), text.end(), pattern, group), std::sregex_token_iterator()};
}

}  // namespace

TEST_CASE("documents: every cited section of method.md exists", "[docs]") {
  const std::string method = ubs::read_text_file(kSource / "docs/method.md");
  const std::vector<std::string> headings = matches(method, std::regex("\n##+ ([0-9](\\.[0-9])?)\\.? "), 1);
  const std::set<std::string> sections(headings.begin(), headings.end());
  REQUIRE(sections.size() > 25);
  // "method.md 2.1, 3.4" cites two sections, "method.md 4.3 step 1" one.
  const std::regex citation("[Mm]ethod\\.md\\)? (section )?([0-9](\\.[0-9])?(, [0-9](\\.[0-9])?)*)");
  const std::regex number("[0-9](\\.[0-9])?");
  std::size_t cited = 0;
  for (const fs::path& path : files_below({"kernels", "host", "cuda_backend", "tools", "tests", "docs"},
                                          {".h", ".hpp", ".cpp", ".cl", ".cu", ".cuh", ".md"})) {
    if (path.parent_path().filename() == "results") continue;  // records of their day
    const std::string text = ubs::read_text_file(path);
    for (const std::string& found : matches(text, citation, 2))
      for (const std::string& section : matches(found, number, 0)) {
        INFO(path.string() << " cites " << section);
        CHECK(sections.contains(section));
        ++cited;
      }
  }
  CHECK(cited > 60);
}

TEST_CASE("documents: links lead to files", "[docs]") {
  std::vector<fs::path> pages = files_below({"docs", "kernels", "data_specs", "tests"}, {".md"});
  for (const char* page : {"README.md", "CONTRIBUTING.md", "SECURITY.md"}) pages.push_back(kSource / page);
  std::size_t links = 0;
  for (const fs::path& page : pages) {
    const std::string text = ubs::read_text_file(page);
    for (const std::string& link : matches(text, std::regex("\\]\\(([^)#:]+)(#[^)]*)?\\)"), 1)) {
      INFO(page.string() << " links to " << link);
      CHECK(fs::exists(page.parent_path() / link));
      ++links;
    }
  }
  CHECK(links > 40);
}
