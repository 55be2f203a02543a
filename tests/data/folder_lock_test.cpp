// SPDX-License-Identifier: Apache-2.0
// Tests the lock of an output folder (host/base/folder_lock.hpp).
#include "host/base/folder_lock.hpp"

#include <unistd.h>

#include "host/base/file.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
namespace fs = std::filesystem;

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
