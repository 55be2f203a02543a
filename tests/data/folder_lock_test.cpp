// SPDX-License-Identifier: Apache-2.0
// Tests the lock of an output folder (host/base/folder_lock.hpp).
#include "host/base/folder_lock.hpp"

#include <unistd.h>

#include <optional>

#include "host/base/file.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
namespace fs = std::filesystem;

TEST_CASE("folder lock: a folder that was removed, replaced or hidden behind a link is detected") {
  const TempFolder folder;
  const std::string part = "this folder was removed or replaced while";
  for (const char* how : {"removed", "replaced", "in use", "link"}) {
    INFO(how);
    const std::string name = how;
    std::optional<FolderLock> lock(std::in_place, folder / "run");
    lock->check_place();
    fs::rename(folder / "run", folder / (name + " away"));
    std::optional<FolderLock> other;
    if (name == "replaced") put(folder / "run/model.ply", "mine");
    if (name == "in use") other.emplace(folder / "run");
    if (name == "link") {
      put(folder / "target/model.ply", "mine");
      fs::create_symlink("target", folder / "run");
    }
    CHECK_THAT(message_of([&] { lock->check_place(); }), Contains(part));
    lock.reset();  // the end of the first run does not release the lock of the other one
    if (other) CHECK(fs::exists(folder / "run/.ubs-lock"));
    other.reset();
    fs::remove_all(folder / "run");
  }
  FolderLock lock(folder / "kept");
  put(folder / "kept/x", "x");
  fs::remove(folder / "kept/.ubs-lock");  // only the lock file: the folder is locked again
  lock.check_place();
  CHECK_THAT(message_of([&] { FolderLock(folder / "kept"); }, ErrorKind::usage), Contains("is writing"));
  fs::rename(folder / "kept", folder / "moved");
  fs::create_symlink("moved", folder / "kept");  // the path leads to the same folder
  lock.check_place();
}

TEST_CASE("folder lock: a lock file with a second name is refused, and its content stays") {
  const TempFolder folder;
  put(folder / "precious.txt", "precious");
  fs::create_directories(folder / "run");
  fs::create_hard_link(folder / "precious.txt", folder / "run/.ubs-lock");
  CHECK_THAT(message_of([&] { FolderLock(folder / "run"); }), Contains(".ubs-lock: this is not an ordinary"));
  CHECK(get(folder / "precious.txt") == "precious");
  CHECK(fs::exists(folder / "run/.ubs-lock"));
}

TEST_CASE("folder lock: only one process can write to a folder, and the error names this process", "[made]") {
  const TempFolder folder;
  {
    const FolderLock lock(folder / "new/run");
    CHECK_THAT(message_of([&] { FolderLock(folder / "new/run"); }, ErrorKind::usage),
               Contains(fmt::format("process {} on ", ::getpid())) && Contains("is writing to this folder"));
  }
  CHECK_FALSE(fs::exists(folder / "new"));  // nothing was written to it
  {
    const FolderLock lock(folder / "kept/made/run/");
    put(folder / "kept/note", "x");
  }
  CHECK(fs::exists(folder / "kept/note"));
  CHECK_FALSE(fs::exists(folder / "kept/made"));
  put(folder / "old/x", "x");
  put(folder / "old/.ubs-lock", "left by a killed process");
  {
    const FolderLock lock(folder / "old");
    write_file_atomically(folder / "old/y", "y");
  }
  CHECK(file_count(folder / "old") == 2);
}
