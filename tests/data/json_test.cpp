// SPDX-License-Identifier: Apache-2.0
// Tests reading JSON: the time is linear in the length of the text, and depth, size and memory are limited.
#include "host/base/json.hpp"

#include <algorithm>

#include "host/base/memory_limit.hpp"
#include "host/base/text.hpp"
#include "host/dataset/frames_json.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

std::string repeated(const std::string& text, std::size_t times) {
  std::string all;
  for (std::size_t i = 0; i < times; ++i) all += text;
  return all;
}

}  // namespace

TEST_CASE("json: every kind of value is read, and members keep the order of the text", "[json]") {
  const std::string text =
      R"({"b":[1,-2,2.5,true,false,null,"é\n"],"a":{},"c":[],"d":{"z":1,"y":[{"x":0}]}})";
  const Json json = parse_json(text, "a.json");
  CHECK(json.dump() == text);
  CHECK(json["b"][0].is_number_unsigned());
  CHECK(json["b"][1].is_number_integer());
  CHECK(json["b"][2].is_number_float());
  CHECK(parse_json("5", "a.json") == 5);
  // If several members have the same name, the last value is used, at the position of the first.
  CHECK(parse_json(R"({"a":1,"b":2,"a":{"c":3}})", "a.json").dump() == R"({"a":{"c":3},"b":2})");
}

TEST_CASE("json: strings and names that ubs has written are decoded", "[json]") {
  const std::string path("a\xff\nb", 4);
  const Json json = Json::object({{path, Json::array({path})}});
  CHECK(parse_own_json(json_text(json), "a.json") == json);
  CHECK(parse_json(json_text(json), "a.json").begin().key() == encode_text(path));
}

TEST_CASE("json: errors contain the file and the position", "[json]") {
  const auto error = [](const std::string& text) {
    return message_of([&] { parse_json(text, "dir/a.json"); });
  };
  CHECK_THAT(error("{\"a\": 1,\n  \"b\": }"),
             Contains("dir/a.json: malformed JSON: ") && Contains("line 2, column 8"));
  CHECK_THAT(error(""), Contains("dir/a.json: malformed JSON") && Contains("line 1"));
  CHECK_THAT(error("{} {}"), Contains("line 1, column 4"));
  CHECK_THAT(error("[1e999]"), Contains("dir/a.json: malformed JSON") && Contains("1e999"));
  CHECK_THAT(error("[\"\xff\"]"), Contains("dir/a.json: malformed JSON"));
}

TEST_CASE("json: UTF-16 and comments are named", "[json]") {
  const auto error = [](const std::string& text) { return message_of([&] { parse_json(text, "a.json"); }); };
  using std::string_literals::operator""s;
  for (const std::string& text : {"\xff\xfe{\0}\0"s, "\xfe\xff\0{\0}"s, "{\0}\0"s, "\0{\0}"s})
    CHECK_THAT(error(text), Contains("a.json: the text is in UTF-16: save it as UTF-8"));
  for (const char* comment : {"// x", "/* x */", "# x"})
    CHECK_THAT(error(fmt::format("{{\n\"a\": 1, {}\n\"b\": 2}}", comment)),
               Contains("comments") && Contains("line 2"));
  CHECK_THAT(error("{\"a\": 1/2}"), !Contains("comments"));
  CHECK(parse_json("{\"a\": \"// # x\"}", "a.json")["a"] == "// # x");
}

TEST_CASE("json: up to 100 levels of nesting are read, and more are rejected", "[json]") {
  const auto nested = [](const std::string& open, const std::string& close, std::size_t depth) {
    return parse_json(repeated(open, depth) + "0" + repeated(close, depth), "a.json");
  };
  CHECK(nested("[", "]", 100).is_array());
  CHECK(nested("{\"a\":", "}", 100).is_object());
  for (const std::size_t depth : {101u, 1000000u})
    CHECK_THAT(message_of([&] { nested("[", "]", depth); }),
               Contains("a.json: the JSON is nested deeper than 100"));
  CHECK_THAT(message_of([&] { nested("{\"a\":", "}", 101); }), Contains("nested deeper than 100"));
}

// With earlier versions, whose time was quadratic in the length of the text, reading these texts took hours.
TEST_CASE("json: arrays and objects with a million values are read", "[json]") {
  constexpr std::size_t kMany = 1'000'000;
  CHECK(parse_json("{\"x\":[" + repeated("{},", kMany) + "{}]}", "a.json")["x"].size() == kMany + 1);
  std::string members = "{";
  for (std::size_t i = 0; i < kMany; ++i) members += fmt::format("\"k{}\":{},", i, i);
  const Json object = parse_own_json(members + "\"end\":-1}", "a.json");
  CHECK(object.size() == kMany + 1);
  CHECK(std::prev(object.end()).key() == "end");
  CHECK(json_text(object) == members + "\"end\":-1}");
}

TEST_CASE("json: a list of frames with many other members at the top level is rejected", "[json]") {
  const TempFolder folder;
  std::string members;
  for (int i = 0; i < 1000; ++i) members += fmt::format("\"k{}\":{},", i, i);
  put(folder / "a.json", "{" + members + "\"frames\":[{}]}");
  CHECK_THAT(message_of([&] { frames::parse_file(folder / "a.json"); }),
             Contains("a.json: the top level of the JSON has 1001 members, but at most 1000 are supported"));
}

// Json::parse() of the JSON library needs a time that is quadratic in the number of members, and does not
// limit depth, size and memory.
TEST_CASE("json: no source file uses the library's own parser, which has no limits", "[json]") {
  std::size_t files = 0;
  for (const char* top : {"host", "tools", "cuda_backend"})
    for (const auto& entry :
         std::filesystem::recursive_directory_iterator(std::string(UBS_SOURCE_DIR) + "/" + top)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".cpp" && extension != ".hpp") continue;
      ++files;
      INFO(entry.path().string());
      const std::string text = get(entry.path());
      CHECK(text.find("Json::parse(") == std::string::npos);
      CHECK(text.find("json::parse(") == std::string::npos);
    }
  CHECK(files > 300);
}

TEST_CASE("json: the error for a file that may need too much memory contains the numbers", "[json]") {
  CHECK_NOTHROW(require_memory(1 << 20, "x"));
  CHECK_THAT(
      message_of([&] { require_memory(std::uint64_t{1} << 60, "a.sog: 5 splats"); }, ErrorKind::memory),
      Contains("a.sog: 5 splats needs 1099511627776 MiB of memory, ") && Contains(" are available"));
  CHECK_THAT(message_of([&] { parse_json(std::string((512u << 20) + 1, ' '), "a.json"); }),
             Contains("a.json: the JSON has 536870913 bytes, but at most 536870912 are supported"));
}

TEST_CASE("messages quote the start and the end of long values", "[json]") {
  const std::string value(5'000'000, 'v');
  const Error error(ErrorKind::data, "a.yaml:1:1: key '" + value + "' is unknown; see --help");
  const std::string text = as_error(error).what();
  CHECK(text.size() < 2200);
  CHECK(text.starts_with("a.yaml:1:1: key 'vvv"));
  CHECK(text.ends_with("vvv' is unknown; see --help"));
  CHECK_THAT(text, Contains(" bytes ...]"));
  CHECK(as_error(error).kind() == ErrorKind::data);
  CHECK(shortened("short") == "short");
  std::string wide;
  for (int i = 0; i < 5000; ++i) wide += "\xe2\x82\xac";  // characters are not split
  const std::string cut = shortened(wide);
  for (std::size_t at = 0; at < cut.size(); at += utf8_length(cut, at)) REQUIRE(utf8_length(cut, at) > 0);
}
