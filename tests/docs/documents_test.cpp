// SPDX-License-Identifier: Apache-2.0
// Tests the documents. Every section of docs/method.md that a comment or a page cites, every file that a link
// refers to, and every file that a comment or a page mentions must exist. Every result must be mentioned, and
// the README must contain the most important information.
#include <algorithm>
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

// Returns the text of group number `group` for every match of the pattern in the text. Group 0 is the whole
// match.
std::vector<std::string> matches(const std::string& text, const std::regex& pattern, int group) {
  return {std::sregex_token_iterator(text.begin(), text.end(), pattern, group), std::sregex_token_iterator()};
}

}  // namespace

TEST_CASE("documents: every cited section of method.md exists", "[docs]") {
  const std::string method = ubs::read_text_file(kSource / "docs/method.md");
  const std::vector<std::string> headings = matches(method, std::regex("\n##+ ([0-9](\\.[0-9]+)?)\\.? "), 1);
  const std::set<std::string> sections(headings.begin(), headings.end());
  REQUIRE(sections.size() > 25);
  // "method.md 2.1, 3.4" cites two sections, and "method.md 4.3 step 1" cites one.
  const std::regex citation("[Mm]ethod\\.md\\)? (section )?([0-9](\\.[0-9]+)?(, [0-9](\\.[0-9]+)?)*)");
  const std::regex number("[0-9](\\.[0-9]+)?");
  std::size_t cited = 0;
  for (const fs::path& path : files_below({"kernels", "host", "cuda_backend", "tools", "tests", "docs"},
                                          {".h", ".hpp", ".cpp", ".cl", ".cu", ".cuh", ".md"})) {
    if (path.parent_path().filename() == "results") continue;  // results describe earlier code
    const std::string text = ubs::read_text_file(path);
    if (text.find("ethod.md") == std::string::npos) continue;  // the regular expression is slow
    for (const std::string& found : matches(text, citation, 2))
      for (const std::string& section : matches(found, number, 0)) {
        INFO(path.string() << " cites " << section);
        CHECK(sections.contains(section));
        ++cited;
      }
  }
  CHECK(cited > 60);
}

TEST_CASE("documents: every page of results is in the index, and a page mentions each table and each image",
          "[docs]") {
  const std::string index = ubs::read_text_file(kSource / "docs/results/README.md");
  std::string pages = ubs::read_text_file(kSource / "README.md");
  for (const fs::path& page : files_below({"docs"}, {".md"})) pages += ubs::read_text_file(page);
  std::size_t found = 0;
  for (const fs::path& path : files_below({"docs/results"}, {".md", ".csv", ".png", ".jpg"})) {
    const std::string name = path.filename().string();
    if (name == "README.md") continue;
    INFO(name);
    CHECK((path.extension() == ".md" ? index : pages).find(name) != std::string::npos);
    ++found;
  }
  CHECK(found > 40);
}

TEST_CASE("documents: links refer to existing files", "[docs]") {
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

namespace {

// Returns the paths from the root of the project that occur in the text, such as "docs/method.md". Uses no
// regular expression, which would take seconds for all sources.
std::vector<std::string> named_files(const std::string& text) {
  const std::string letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";
  const std::set<std::string> extensions{".md", ".cpp", ".hpp", ".h",   ".cl",  ".cu",  ".cuh",
                                         ".py", ".sh",  ".csv", ".jpg", ".png", ".yaml"};
  std::vector<std::string> found;
  for (const char* folder :
       {"docs/", "tests/", "tools/", "host/", "kernels/", "cuda_backend/", "data_specs/"}) {
    for (std::size_t at = text.find(folder); at != std::string::npos; at = text.find(folder, at + 1)) {
      if (at > 0 && (letters + "./$}").find(text[at - 1]) != std::string::npos) continue;
      std::string name = text.substr(at, text.find_first_not_of(letters + "./", at) - at);
      while (name.ends_with('.')) name.pop_back();  // the end of a sentence
      if (extensions.contains(fs::path(name).extension().string())) found.push_back(name);
    }
  }
  return found;
}

}  // namespace

// Pages in docs/results keep the file names from the time when they were written.
TEST_CASE("documents: files that comments and pages mention exist", "[docs]") {
  std::vector<fs::path> files =
      files_below({"kernels", "host", "cuda_backend", "tools", "tests", "docs", "data_specs"},
                  {".h", ".hpp", ".cpp", ".cl", ".cu", ".cuh", ".md", ".py", ".sh", ".yaml"});
  for (const char* page : {"README.md", "CONTRIBUTING.md", "SECURITY.md"}) files.push_back(kSource / page);
  std::size_t names = 0;
  for (const fs::path& path : files) {
    if (path.parent_path().filename() == "results") continue;
    for (const std::string& name : named_files(ubs::read_text_file(path))) {
      INFO(path.string() << " names " << name);
      CHECK(fs::exists(kSource / name));
      ++names;
    }
  }
  CHECK(names > 1000);
}

TEST_CASE("documents: the README names authors, devices, a test PSNR and the tutorial, which has an image",
          "[docs]") {
  const std::string text = ubs::read_text_file(kSource / "README.md");
  for (const char* part : {"Universal Beta Splatting](https://arxiv.org/abs/2510.03312) by Rong Liu",
                           "OpenCL and CUDA", "two CPU cores", "test PSNR", "docs/tutorial.md"}) {
    INFO(part);
    CHECK(text.find(part) != std::string::npos);
  }
  CHECK(ubs::read_text_file(kSource / "docs/tutorial.md").find(".jpg") != std::string::npos);
}

TEST_CASE("documents: every promise of SECURITY.md names a test", "[docs]") {
  const std::string page = ubs::read_text_file(kSource / "SECURITY.md");
  const std::size_t end = page.find("## Files and places that are trusted");
  REQUIRE(end != std::string::npos);
  std::size_t promises = 0;
  for (std::size_t at = 0; (at = page.find("\n* **", at)) < end; ++at) {
    const std::string promise =
        page.substr(at + 1, std::min(page.find("\n* ", at + 1), page.find("\n\n", at + 1)) - at - 1);
    INFO(promise);
    const std::vector<std::string> tests =
        matches(promise, std::regex("`(tests/[a-z_]+/[a-z_]+\\.(cpp|py))`"), 1);
    CHECK_FALSE(tests.empty());
    for (const std::string& test : tests) CHECK(fs::exists(kSource / test));
    ++promises;
  }
  CHECK(promises > 15);
}

// SECURITY.md promises that no file can name a program to run. Therefore only few places start programs:
// COLMAP, the converters of OpenUSD, and xdg-open.
TEST_CASE("documents: only the known places start programs", "[docs]") {
  const std::regex starts(
      "\\b(fork|vfork|execv|execve|execvp|execl|execlp|popen|system|posix_spawn|posix_spawnp|"
      "run_child)\\(");
  std::set<std::string> found;
  for (const fs::path& path : files_below({"host", "tools", "cuda_backend"}, {".cpp", ".hpp"})) {
    const std::string text = std::regex_replace(ubs::read_text_file(path), std::regex("//[^\n]*"), "");
    if (std::regex_search(text, starts)) found.insert(path.lexically_relative(kSource).string());
  }
  CHECK(found == std::set<std::string>{"host/base/child_process.cpp", "host/base/child_process.hpp",
                                       "host/formats/usdc.cpp", "tools/cameras.cpp", "tools/view.cpp"});
}
