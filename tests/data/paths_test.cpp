// SPDX-License-Identifier: Apache-2.0
// Tests functions for paths and names from untrusted sources: operations of the file system that throw only
// Error (host/base/paths.hpp, host/base/temporary_folder.hpp), the encoding of arbitrary bytes as text
// (host/base/text.hpp), and the conversion of names of views to file names (host/dataset/view_names.hpp).
#include "host/base/paths.hpp"

#include <random>
#include <regex>

#include "host/base/temporary_folder.hpp"
#include "host/base/text.hpp"
#include "host/dataset/view_names.hpp"
#include "tests/support/set_variable.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
namespace fs = std::filesystem;

namespace {

std::vector<std::string> settled(const std::vector<std::string>& names) {
  std::vector<View> views(names.size());
  for (std::size_t i = 0; i < names.size(); ++i) views[i].name = names[i];
  make_view_names_unique(views);
  std::vector<std::string> result;
  for (const View& view : views) result.push_back(view.name);
  return result;
}

using Names = std::vector<std::string>;

}  // namespace

TEST_CASE("paths: names that are too long do not exist and cannot be created", "[paths]") {
  TempFolder folder;
  const fs::path longest = folder / std::string(300, 'x');
  CHECK_FALSE(path_exists(longest));
  CHECK_FALSE(is_folder(longest));
  CHECK_FALSE(is_regular(longest / "a"));
  CHECK_FALSE(is_dead_link(longest));
  CHECK_THAT(message_of([&] { make_folders(longest); }),
             Contains("cannot create the folder: File name too long"));
  CHECK_THAT(message_of([&] { folder_entries(longest); }), Contains("cannot list"));
}

TEST_CASE("paths: a loop of symbolic links is a data error, not an internal error", "[paths]") {
  TempFolder folder;
  fs::create_symlink("b", folder / "a");
  fs::create_symlink("a", folder / "b");
  for (const auto& ask : {path_exists, is_folder, is_regular})
    CHECK_THAT(message_of([&] { ask(folder / "a"); }), Contains("a: cannot be accessed: Too many levels"));
  CHECK_THAT(message_of([&] { resolved_path(folder / "a" / "x"); }), Contains("cannot be resolved"));
  CHECK_THAT(message_of([&] { make_folders(folder / "a" / "x"); }), Contains("Too many levels"));
}

TEST_CASE("paths: files, folders and links are recognised, and links are followed", "[paths]") {
  TempFolder folder;
  put(folder / "file", "abc");
  fs::create_symlink("file", folder / "link");
  fs::create_symlink("none", folder / "dangling");
  make_folders(folder / "x/y");
  make_folders(folder / "x/y");
  CHECK(is_regular(folder / "link"));
  CHECK_FALSE(path_exists(folder / "dangling"));
  CHECK_FALSE(path_exists(folder / "file" / "below"));
  CHECK(is_dead_link(folder / "dangling"));
  CHECK_FALSE(is_dead_link(folder / "link"));
  CHECK(folder_entries(folder.path()) ==
        std::vector<fs::path>{folder / "dangling", folder / "file", folder / "link", folder / "x"});
  CHECK(resolved_path(folder / "x/../link") == fs::canonical(folder / "file"));
  CHECK(resolved_path(folder / "link/../none/..") == fs::canonical(folder.path()));
  CHECK(resolved_path("no-such-folder/../x") == fs::current_path() / "x");
  CHECK_THAT(message_of([&] { make_folders(folder / "file"); }), Contains("file"));
}

TEST_CASE("paths: if TMPDIR does not name a folder, a temporary folder is a data error", "[paths]") {
  TempFolder folder;
  const Variable temporary("TMPDIR", (folder / "none").c_str());
  CHECK_THAT(message_of([] { const TemporaryFolder made; }), Contains("set TMPDIR to a writable folder"));
}

// paths.hpp has a function in place of most of these functions of std::filesystem. Many callers catch the
// Error that it throws, and it accepts names that are too long. This test allows the overloads that take an
// error_code.
TEST_CASE("paths: no source uses functions of std::filesystem that paths.hpp replaces", "[paths]") {
  const std::regex call(
      R"(\b(?:fs|std::filesystem)::(?:exists|is_\w+|\w*status|create_director(?:y|ies)|\w*directory_iterator|)"
      R"(\w*canonical|relative|proximate)\b([^;{]*))");
  std::size_t files = 0;
  for (const char* top : {"host", "tools", "cuda_backend"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / top)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".cpp" && extension != ".hpp") continue;
      if (entry.path().filename() == "paths.cpp") continue;
      ++files;
      const std::string text = get(entry.path());
      if (text.find("fs::") == std::string::npos && text.find("filesystem::") == std::string::npos) continue;
      for (std::sregex_iterator at(text.begin(), text.end(), call), end; at != end; ++at) {
        const std::string arguments = (*at)[1];
        const bool looks = std::regex_search(arguments, std::regex(R"([(,]\s*(?:error|ignored|none)\))"));
        INFO(entry.path().string() << ": " << at->str());
        const bool type_only = arguments.starts_with(
            "(status)");  // function of a file_status, which does not access the file system
        CHECK((looks || type_only));
      }
    }
  CHECK(files > 300);
}

TEST_CASE("text: any bytes are preserved, and the result is UTF-8 on one line", "[paths]") {
  CHECK(encode_text("/data/gr\xc3\xbc\xc3\x9f/a b%20") == "/data/gr\xc3\xbc\xc3\x9f/a b%20");
  CHECK(encode_text("caf\xe9") == "caf\\xe9");
  CHECK(encode_text("a\nb\x7f") == "a\\x0ab\\x7f");
  CHECK(encode_text("a\\b\\xe9\\xZZ\\xE9") == "a\\b\\x5cxe9\\xZZ\\xE9");
  CHECK(encode_text("\xed\xa0\x80") == "\\xed\\xa0\\x80");  // a surrogate
  CHECK(encode_text("\xc0\xbc") == "\\xc0\\xbc");           // an overlong encoding of <
  CHECK(encode_text(std::string(1, '\0')) == "\\x00");
  CHECK(decode_text("caf\\xe9 \\xE9 \\x") == "caf\xe9 \\xE9 \\x");
  std::mt19937 random(1);
  const std::string hard = std::string("\\x0e9f") + '\0' + "\n\xc3\xa9\xe2\x82\xac\xf0\x9f\x8e\x89\xff%\"'";
  for (int i = 0; i < 20000; ++i) {
    std::string bytes;
    for (std::size_t n = random() % 12; n > 0; --n)
      bytes += i % 2 ? static_cast<char>(random()) : hard[random() % hard.size()];
    const std::string text = encode_text(bytes);
    REQUIRE(decode_text(text) == bytes);
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t length = utf8_length(text, at);
      REQUIRE(length > 0);
      REQUIRE(static_cast<unsigned char>(text[at]) >= 0x20);
      at += length;
    }
  }
}

TEST_CASE("view names: no name leads out of its folder or has a special meaning", "[paths]") {
  for (const char* name : {"r_0", "r_0.5", "cam1_0001", "a b", "50%", "gr\xc3\xbc\xc3\x9f", "caf\xe9",
                           ".hidden", "-x", "concert", "com", "x..y", "%2F"})
    CHECK(safe_file_name(name) == name);
  CHECK(safe_file_name("../../x") == "..%2F..%2Fx");
  CHECK(safe_file_name("/etc/passwd") == "%2Fetc%2Fpasswd");
  CHECK(safe_file_name("a\\b") == "a%5Cb");
  CHECK(safe_file_name("..") == "%2E.");
  CHECK(safe_file_name(".") == "%2E");
  CHECK(safe_file_name("") == "view");
  CHECK(safe_file_name(std::string("a\0b\n\x1b[2J", 8)) == "a%00b%0A%1B[2J");
  CHECK(safe_file_name("CON") == "%43ON");
  CHECK(safe_file_name("nul.tar") == "%6Eul.tar");
  CHECK(safe_file_name("lpt9") == "%6Cpt9");
  CHECK(safe_file_name("c:x?*<>|\"") == "c%3Ax%3F%2A%3C%3E%7C%22");
  const std::string a(300, 'a');
  CHECK(safe_file_name(a).size() == 180);
  CHECK(safe_file_name(a) != safe_file_name(a + "b"));
  std::string wide;
  while (wide.size() < 300) wide += "\xe2\x82\xac";
  CHECK(encode_text(safe_file_name(wide)) == safe_file_name(wide));  // no character is split
  for (const std::string& name : {std::string("../x"), a, std::string(), wide, std::string("AUX.b/c")})
    CHECK(safe_file_name(safe_file_name(name)) == safe_file_name(name));
}

TEST_CASE("view names: each view has its own file", "[paths]") {
  CHECK(settled({"r", "r", "r_2", "r"}) == Names{"r", "r_3", "r_2", "r_4"});
  CHECK(settled({"a", "A", "a"}) == Names{"a", "A_2", "a_3"});    // some file systems ignore case
  CHECK(settled({"a/b", "a%2Fb"}) == Names{"a%2Fb", "a%2Fb_2"});  // equal after replacing unsafe characters
  CHECK(settled({"x", "x_alpha"}) == Names{"x", "x_alpha_2"});    // the alpha of x is written to x_alpha.png
  CHECK(settled({"x_DEPTH", "x"}) == Names{"x_DEPTH", "x_2"});
  const Names once = settled({"..", "..", "con", "x", "X", "x_2", ""});
  CHECK(settled(once) == once);
  const std::vector<std::string> many(20000, "same");
  const Names kept = settled(many);
  CHECK(kept.back() == "same_20000");
}
