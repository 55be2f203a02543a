// SPDX-License-Identifier: Apache-2.0
// What may be replaced and deleted (host/base/made_files.hpp), where results may go (output_place.hpp) and
// who may write there (folder_lock.hpp).
#include "host/base/made_files.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <sstream>
#include <thread>

#include "host/base/crc32.hpp"
#include "host/base/file.hpp"
#include "host/base/folder_lock.hpp"
#include "host/base/output_place.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
namespace fs = std::filesystem;

namespace {

// The name of the running command, and the one before afterwards.
class As {
 public:
  explicit As(const std::string& name) : before_(maker()) { set_maker(name); }
  ~As() { set_maker(before_); }
  As(const As&) = delete;

 private:
  std::string before_;
};

std::string refusal(const fs::path& file) {
  return message_of([&] { write_file_atomically(file, "new"); }, ErrorKind::usage);
}

}  // namespace

TEST_CASE("made files: threads that begin a list at once spoil no line of it", "[made]") {
  for (int round = 0; round < 100; ++round) {
    const TempFolder folder;
    std::atomic<int> ready{0};
    std::vector<std::thread> threads;
    for (int i = 0; i < 4; ++i)
      threads.emplace_back([&, i] {
        for (++ready; ready < 4;) continue;
        note_made(folder / fmt::format("file{}", i), {});
      });
    for (std::thread& thread : threads) thread.join();
    std::istringstream lines(get(folder / kMadeFiles));
    int whole = 0;
    for (std::string line; std::getline(lines, line);)
      for (int i = 0; i < 4; ++i) whole += line.ends_with(fmt::format(" 0000000000000001 file{}", i));
    REQUIRE(whole == 4);
  }
}

// As a process does that begins in the folder: what another has just opened is not to be taken from it.
// Without a second look at the file that was just locked one write of 700 failed.
TEST_CASE("made files: a search for abandoned files takes none that is being written", "[made]") {
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

TEST_CASE("made files: only a result of the same command, as it was left, is replaced", "[made]") {
  const TempFolder folder;
  const As command("pack");
  put(folder / "mine", "precious");
  CHECK_THAT(refusal(folder / "mine"), Contains("mine: is not known to be made by this program"));
  CHECK(get(folder / "mine") == "precious");

  write_file_atomically(folder / "a b\nc", "first");
  CHECK(is_own_result(folder / "a b\nc"));
  write_file_atomically(folder / "a b\nc", "second");
  CHECK(get(folder / "a b\nc") == "second");
  write_file_atomically(folder / "a b", "second");  // messages are of one line
  {
    const As other("eval");
    write_file_atomically(folder / "e", "other");
    CHECK_THAT(message_of([&] { check_replaceable(folder / "a b"); }, ErrorKind::usage),
               Contains("'ubs pack'"));
  }
  put(folder / "a b", "SECOND");  // of equal length
  CHECK_FALSE(is_own_result(folder / "a b"));
  CHECK_THAT(refusal(folder / "a b"), Contains("was changed since"));
  CHECK(get(folder / "a b") == "SECOND");
  CHECK(file_count(folder.path()) == 4);
}

TEST_CASE("made files: another process knows them by the list alone, wherever the folder went", "[made]") {
  const TempFolder folder;
  const As command("pack");
  fs::create_directory(folder / "one");
  write_file_atomically(folder / "one/a", "first");
  fs::copy(folder / "one", folder / "two");  // other inodes, other times
  CHECK(is_own_result(folder / "two/a"));
  write_file_atomically(folder / "two/a", "second");
  // A list that was cut short or holds nonsense says less, and names in other folders say nothing.
  put(folder / "three/.ubs-files",
      "# x\npack whole 5\npack whole 3 0000000000000000 ../two/a\n\xff\nnonsense");
  put(folder / "three/a", "first");
  CHECK_THAT(refusal(folder / "three/a"), Contains("not known"));
  put(folder / "three/.ubs-files", get(folder / "three/.ubs-files") + get(folder / "one/.ubs-files"));
  CHECK(is_own_result(folder / "three/a"));
}

TEST_CASE("made files: content is told apart also where files end in their own CRC-32", "[made]") {
  const auto with_crc = [](std::string text) {
    const std::uint32_t crc = crc32(std::as_bytes(std::span(text)));
    text.append(reinterpret_cast<const char*>(&crc), sizeof crc);
    Content content;
    content.add(std::as_bytes(std::span(text)));
    return content;
  };
  CHECK(with_crc("one") == with_crc("one"));
  CHECK(with_crc("one").crc == with_crc("two").crc);
  CHECK_FALSE(with_crc("one") == with_crc("two"));
}

// Of every line of the same size it was read anew.
TEST_CASE("made files: a file that was replaced often is read once", "[made]") {
  const TempFolder folder;
  constexpr std::size_t kBytes = 1'000'000;
  for (const char content : {'a', 'b', 'c', 'd', 'e', 'f'}) {
    put(folder / "a", std::string(kBytes, content));
    adopt(folder / "a");
  }
  const auto bytes_read = [] {
    std::ifstream counters("/proc/self/io");
    std::string word;
    std::size_t bytes = 0;
    counters >> word >> bytes;
    return bytes;
  };
  const auto of_check = [&] {
    const std::size_t before = bytes_read();
    CHECK(is_own_result(folder / "a"));
    return bytes_read() - before;
  };
  CHECK(of_check() < 2 * kBytes);
  put(folder / "a", std::string(kBytes, 'a'));  // of the oldest line
  CHECK(of_check() < 2 * kBytes);
}

TEST_CASE("made files: links, folders and devices are never replaced", "[made]") {
  const TempFolder folder;
  write_file_atomically(folder / "a", "ours");
  fs::create_symlink("a", folder / "link");
  fs::create_symlink("nowhere", folder / "dangling");
  fs::create_directory(folder / "inner");
  CHECK_THAT(refusal(folder / "link"), Contains("symbolic link"));
  CHECK_THAT(refusal(folder / "dangling"), Contains("symbolic link"));
  CHECK_THAT(refusal("/dev/null"), Contains("not an ordinary file"));
  CHECK_THAT(message_of([&] { write_file_atomically(folder / "inner", "x"); }), Contains("is a folder"));
  CHECK(fs::is_symlink(folder / "dangling"));
}

TEST_CASE("made files: a log may grow, but not begin otherwise", "[made]") {
  const TempFolder folder;
  write_file_atomically(folder / "log", "head\n", FileUse::log);
  put(folder / "log", "head\nrow\n");
  CHECK(is_own_result(folder / "log"));
  put(folder / "log", "Head\nrow\n");
  CHECK_FALSE(is_own_result(folder / "log"));
}

TEST_CASE("made files: removal takes what is ours, or nothing at all", "[made]") {
  const TempFolder folder;
  const As command("train");
  fs::create_directories(folder / "r");
  for (const char* name : {"a", "b", "c"}) write_file_atomically(folder / "r" / name, name);
  put(folder / "r/photo.png", "photograph");
  put(folder / "r/b", "replaced by the user");
  CHECK_THAT(message_of([&] { remove_made(folder / "r"); }, ErrorKind::usage), Contains("was changed"));
  CHECK(fs::exists(folder / "r/a"));
  fs::remove(folder / "r/b");
  CHECK_FALSE(is_only_made(folder.path(), {"train"}));
  remove_made(folder / "r");
  CHECK(file_count(folder / "r") == 1);
  CHECK(get(folder / "r/photo.png") == "photograph");
  fs::remove(folder / "r/photo.png");
  write_file_atomically(folder / "r/a", "a");
  fs::create_directory(folder / "r/sub");
  write_file_atomically(folder / "r/sub/a", "a");
  put(folder / "r/.ubs-tmp-1-1", "left");
  CHECK(is_only_made(folder / "r", {"train"}));
  CHECK_FALSE(is_only_made(folder / "r", {"eval"}));
  remove_made(folder / "r/sub");
  remove_made(folder / "r");
  CHECK_FALSE(fs::exists(folder / "r"));
  remove_made(folder / "none");
}

TEST_CASE("made files: temporary files are removed when nobody holds them", "[made]") {
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

TEST_CASE("output place: not onto an input, by whatever name", "[made]") {
  const TempFolder folder;
  write_file_atomically(folder / "m.ply", "model");
  fs::create_hard_link(folder / "m.ply", folder / "hard.ply");
  fs::create_directory_symlink(".", folder / "here");
  const auto said = [&](const Paths& files) {
    return message_of([&] { check_output_files(files, {"", folder / "m.ply"}); }, ErrorKind::usage);
  };
  for (const fs::path& out : {folder / "m.ply", folder / "hard.ply", folder / "here/m.ply"})
    CHECK_THAT(said({out}), Contains("is the input"));
  CHECK_THAT(said({folder / "x", folder / "here/x"}), Contains("two results"));
  CHECK(said({folder / "x", "", folder / "here/y"}).empty());
}

TEST_CASE("output place: apart from the data, all links followed", "[made]") {
  const TempFolder folder;
  put(folder / "data/poses_bounds.npy", "cameras");
  put(folder / "data/photos/a.JPG", "photograph");
  put(folder / "data/models/one/cameras.bin", "cameras");
  put(folder / "data/notes/a.txt", "text");
  put(folder / "data/images/a.png", "photograph");
  put(folder / "set/F.ubsd", "packed");
  fs::create_directory_symlink(folder / "data/images", folder / "alias");
  fs::create_directories(folder / "elsewhere");
  const auto said = [&](const std::string& out, const std::string& data) {
    return message_of([&] { check_apart(folder / out, {folder / data}); }, ErrorKind::usage);
  };
  CHECK_THAT(said("data", "data"), Contains("is the data"));
  CHECK_THAT(said("data/", "data"), Contains("is the data"));
  CHECK_THAT(said("elsewhere/../data", "data"), Contains("is the data"));
  for (const char* out :
       {"data/images", "alias", "data/photos", "data/models/one", "data/masks", "data/cam07", "data/sparse"})
    CHECK_THAT(said(out, "data"), Contains("is a folder of images or cameras"));
  for (const char* out : {"data/run/7", "data/output", "data/notes", "alias/run"})
    CHECK(said(out, "data").empty());
  fs::create_directory(folder / "data/pictures");
  write_file_atomically(folder / "data/pictures/a.png", "a result");
  CHECK(said("data/pictures", "data").empty());
  CHECK_THAT(said("", "data/images"), Contains("holds the data"));
  CHECK_THAT(said("set", "set/F.ubsd"), Contains("holds the data"));
  for (const char* out : {"data2", "elsewhere", "elsewhere/data", "run"}) CHECK(said(out, "data").empty());
  CHECK(said("data", "not there").empty());
}

TEST_CASE("folder lock: one holder at a time, and the second is told who", "[made]") {
  const TempFolder folder;
  const As command("train");
  {
    const FolderLock lock(folder / "new/run");
    CHECK_THAT(
        message_of([&] { FolderLock(folder / "new/run"); }, ErrorKind::usage),
        Contains(fmt::format("'ubs train', process {} on ", ::getpid())) && Contains("is writing there"));
  }
  CHECK_FALSE(fs::exists(folder / "new/run"));  // nothing came into it
  put(folder / "old/x", "x");
  put(folder / "old/.ubs-lock", "left by a killed process");
  {
    const FolderLock lock(folder / "old");
    write_file_atomically(folder / "old/y", "y");
  }
  CHECK(file_count(folder / "old") == 2);
}
