// SPDX-License-Identifier: Apache-2.0
// Whole-file reading and atomic writing (host/base/file.hpp), and the parallel loop.
#include "host/base/file.hpp"

#include "host/base/parallel.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

TEST_CASE("file: what is written is read back, and no temporary stays", "[file]") {
  TempFolder folder;
  const std::string text("a\0b\n\xff", 5);
  write_file_atomically(folder / "x", text);
  CHECK(read_text_file(folder / "x") == text);
  CHECK(read_file(folder / "x").size() == 5);
  write_file_atomically(folder / "x", std::string_view());
  CHECK(read_text_file(folder / "x").empty());
  CHECK(file_count(folder.path()) == 1);
}

TEST_CASE("file: an abandoned write leaves the old content", "[file]") {
  TempFolder folder;
  put(folder / "x", "old");
  {
    AtomicFile file(folder / "x");
    file.write(std::string_view("new"));
  }
  CHECK(get(folder / "x") == "old");
  CHECK(file_count(folder.path()) == 1);
}

TEST_CASE("file: errors name the path", "[file]") {
  TempFolder folder;
  CHECK_THAT(message_of([&] { read_file(folder / "none"); }), Contains("none: no such file"));
  CHECK_THAT(message_of([&] { read_file(folder.path()); }), Contains("is a folder"));
  CHECK_THAT(message_of([&] { write_file_atomically(folder.path(), "x"); }), Contains("is a folder"));
  CHECK_THAT(message_of([&] { write_file_atomically(folder / "no/such/x", "x"); }),
             Contains("no/such/x: cannot write"));
}

TEST_CASE("parallel_for: every item once, the first failure wins", "[file]") {
  std::vector<int> hits(1000, 0);
  parallel_for(hits.size(), [&](std::size_t i) { ++hits[i]; });
  CHECK(std::all_of(hits.begin(), hits.end(), [](int h) { return h == 1; }));
  parallel_for(0, [](std::size_t) { FAIL(); });
  const auto failing = [](std::size_t i) {
    if (i % 10 == 7) fail(ErrorKind::data, "item {}", i);
  };
  CHECK(message_of([&] { parallel_for(100, failing); }) == "item 7");
}
