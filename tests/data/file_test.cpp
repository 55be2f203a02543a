// SPDX-License-Identifier: Apache-2.0
// Tests reading whole files, atomic writing (host/base/file.hpp), and the parallel loop.
#include "host/base/file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <thread>

#include "host/base/parallel.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
namespace fs = std::filesystem;

TEST_CASE("file: written content is read back, and no temporary file remains", "[file]") {
  TempFolder folder;
  const std::string text("a\0b\n\xff", 5);
  write_file_atomically(folder / "x", text);
  CHECK(read_text_file(folder / "x") == text);
  CHECK(read_file(folder / "x").size() == 5);
  write_file_atomically(folder / "x", std::string_view());
  CHECK(read_text_file(folder / "x").empty());
  CHECK(file_count(folder.path()) == 1);
}

TEST_CASE("file: a file that is written without commit() keeps its old content", "[file]") {
  TempFolder folder;
  write_file_atomically(folder / "x", "old");
  {
    AtomicFile file(folder / "x");
    file.write(std::string_view("new"));
  }
  CHECK(get(folder / "x") == "old");
  CHECK(file_count(folder.path()) == 1);
}

TEST_CASE("file: chunks of all sizes are written, and files that an encoder writes by name are accepted",
          "[file]") {
  TempFolder folder;
  std::string expected;
  AtomicFile file(folder / "x");
  for (const std::size_t size : {1, 0, 300000, 100, 262144, 262143, 1, 1, 1000000}) {
    const std::string piece(size, static_cast<char>('a' + expected.size() % 26));
    file.write(piece);
    expected += piece;
  }
  file.commit();
  CHECK(get(folder / "x") == expected);
  {
    AtomicFile other(folder / "y", FileUse::result, ".mp4");
    CHECK(other.temporary().extension() == ".mp4");
    put(other.temporary(), expected);
    other.commit();
  }
  CHECK(get(folder / "y") == expected);
  write_file_atomically(folder / "x", "1");
  write_file_atomically(folder / "y", "2");
  CHECK(file_count(folder.path()) == 2);
}

TEST_CASE("file: links, folders and devices are never replaced", "[file]") {
  const TempFolder folder;
  put(folder / "a", "old");
  fs::create_symlink("a", folder / "link");
  fs::create_symlink("nowhere", folder / "dangling");
  const auto refusal = [](const fs::path& file) {
    return message_of([&] { write_file_atomically(file, "new"); });
  };
  CHECK_THAT(refusal(folder / "link"), Contains("link: this is a symbolic link"));
  CHECK_THAT(refusal(folder / "dangling"), Contains("dangling: this is a symbolic link"));
  CHECK_THAT(refusal("/dev/null"), Contains("this is a device, a pipe or a socket"));
  CHECK(get(folder / "a") == "old");
  CHECK(fs::is_symlink(folder / "dangling"));
}

// Every process that starts in a folder searches it for abandoned files, and must not delete a file that
// another process has just opened. When remove_abandoned() did not yet check a file again after locking it,
// one of 700 writes failed.
TEST_CASE("file: a search for abandoned files deletes no file that is being written", "[file]") {
  const TempFolder folder;
  std::atomic<bool> done{false};
  std::thread searching([&] {
    while (!done) remove_abandoned(folder.path());
  });
  int failed = 0;
  for (int i = 0; i < 5'000; ++i)
    failed += !message_of([&] { write_file_atomically(folder / "file", "text", FileUse::cache); }).empty();
  done = true;
  searching.join();
  CHECK(failed == 0);
}

TEST_CASE("file: temporary files are removed if no process has locked them", "[file]") {
  const TempFolder folder;
  put(folder / ".ubs-tmp-1-0", "left by a killed process");
  put(folder / ".ubs-tmp-1-1", "in work");
  put(folder / "x.tmp-1-1", "somebody's");
  const int held = ::open((folder / ".ubs-tmp-1-1").c_str(), O_RDWR);
  REQUIRE(::flock(held, LOCK_EX) == 0);
  const AtomicFile writing(folder / "y");
  write_file_atomically(folder / "x", "x");
  remove_abandoned(folder.path());
  CHECK_FALSE(fs::exists(folder / ".ubs-tmp-1-0"));
  CHECK(fs::exists(folder / ".ubs-tmp-1-1"));
  CHECK(fs::exists(folder / "x.tmp-1-1"));
  CHECK(fs::exists(writing.temporary()));
  ::close(held);
}

TEST_CASE("file: errors contain the path", "[file]") {
  TempFolder folder;
  CHECK_THAT(message_of([&] { read_file(folder / "none"); }), Contains("none: no such file"));
  std::filesystem::create_symlink("loop", folder / "loop");  // a link to itself
  CHECK_THAT(message_of([&] { read_file(folder / "loop"); }), Contains("loop: cannot be accessed: "));
  CHECK_THAT(message_of([&] { read_file(folder.path()); }), Contains("is a folder"));
  CHECK_THAT(message_of([&] { write_file_atomically(folder.path(), "x"); }), Contains("is a folder"));
  CHECK_THAT(message_of([&] { write_file_atomically(folder / "no/such/x", "x"); }),
             Contains("no/such/x: cannot write"));
}

TEST_CASE("file: links to missing files and pointers of Git LFS are named as such", "[file]") {
  const TempFolder folder;
  std::filesystem::create_symlink("gone", folder / "link");
  CHECK_THAT(message_of([&] { read_file(folder / "link"); }),
             Contains("link: this is a symbolic link to a file that does not exist"));
  put(folder / "p", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n");
  CHECK_THAT(message_of([&] { read_file(folder / "p"); }), Contains("git lfs pull"));
  put(folder / "p", "version https://git-lfs.example.com/spec/v1");
  CHECK(read_text_file(folder / "p").size() == 43);
  put(folder / "p", "\xef\xbb\xbftext");  // with a byte order mark
  CHECK(read_text_file(folder / "p") == "text");
  CHECK(read_file(folder / "p").size() == 7);
}

TEST_CASE("parallel_for: every item is processed once, and the first failure is reported", "[file]") {
  std::vector<int> hits(1000, 0);
  parallel_for(hits.size(), [&](std::size_t i) { ++hits[i]; });
  CHECK(std::all_of(hits.begin(), hits.end(), [](int h) { return h == 1; }));
  parallel_for(0, [](std::size_t) { FAIL(); });
  const auto failing = [](std::size_t i) {
    if (i % 10 == 7) fail(ErrorKind::data, "item {}", i);
  };
  CHECK(message_of([&] { parallel_for(100, failing); }) == "item 7");
}
