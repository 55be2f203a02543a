// SPDX-License-Identifier: Apache-2.0
// Tests the folder in which the driver stores compiled kernels. ubs checks before use that the folder can be
// written, and removes damaged files and files that PoCL no longer needs.
#include "host/opencl/driver_cache.hpp"

#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <chrono>

#include "host/base/cache_folder.hpp"
#include "tests/support/set_variable.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

void put_aged(const fs::path& file, fs::file_time_type::duration age) {
  test::put(file, "x");
  fs::last_write_time(file, fs::file_time_type::clock::now() - age);
}

TEST_CASE("old temporary files and unused programs of PoCL are removed, and all other files are kept") {
  const test::TempFolder folder;
  put_aged(folder / "tempfile_old", 1h);
  put_aged(folder / "tempfile_old.so.o", 1h);
  put_aged(folder / "tempfile_new", 1min);
  put_aged(folder / "other", 10000h);
  put_aged(folder / "AB/UNUSED/last_accessed", 100 * 24h);
  put_aged(folder / "AB/UNUSED/kernel/1-1-1/kernel.so", 100 * 24h);
  put_aged(folder / "AB/USED/last_accessed", 80 * 24h);
  put_aged(folder / "AB/USED/program.bc", 200 * 24h);
  // This program has no file last_accessed. That is the case while PoCL still writes the program.
  put_aged(folder / "CD/EMPTY/program.bc", 200 * 24h);
  opencl::tidy_driver_cache(folder.path());
  CHECK_FALSE(fs::exists(folder / "tempfile_old"));
  CHECK_FALSE(fs::exists(folder / "tempfile_old.so.o"));
  CHECK(fs::exists(folder / "tempfile_new"));
  CHECK(fs::exists(folder / "other"));
  CHECK_FALSE(fs::exists(folder / "AB/UNUSED"));
  CHECK(fs::exists(folder / "AB/USED/program.bc"));
  CHECK(fs::exists(folder / "CD/EMPTY/program.bc"));
  // tidy_driver_cache() searches for unused programs at most once a day, so this second call removes none.
  put_aged(folder / "AB/UNUSED/last_accessed", 100 * 24h);
  opencl::tidy_driver_cache(folder.path());
  CHECK(fs::exists(folder / "AB/UNUSED"));
  opencl::tidy_driver_cache(folder / "missing");
  CHECK_FALSE(fs::exists(folder / "missing"));
}

TEST_CASE("a cache folder is created and checked, and a temporary one must be accessible only to this user") {
  const test::TempFolder folder;
  CHECK(cache_defect(folder / "a/b").empty());
  CHECK(fs::is_empty(folder / "a/b"));
  test::put(folder / "file", "");
  CHECK_FALSE(cache_defect(folder / "file").empty());
  CHECK_FALSE(cache_defect(folder / "file/below").empty());

  const test::Variable temporary("TMPDIR", folder.path().c_str());
  const fs::path own = temporary_cache();
  REQUIRE(own.parent_path() == folder.path());
  CHECK((fs::status(own).permissions() & fs::perms::mask) == fs::perms::owner_all);
  CHECK(usable_cache(folder / "file/below") == own);
  CHECK(cache_defects().find((folder / "file/below").string()) != std::string::npos);
  REQUIRE(::chmod(own.c_str(), 0777) == 0);  // now all users can write to the folder
  CHECK(temporary_cache().empty());
  fs::remove(own);
  fs::create_directory_symlink(folder / "a", own);
  CHECK(temporary_cache().empty());
}

// A power cut can leave a file empty, truncated, or filled with zeros if its content has not been written to
// the disk. The test damages files in these ways, and also inverts a single bit.
TEST_CASE("damaged programs of a kernel cache are removed, and intact ones are kept") {
  const test::TempFolder folder;
  const auto make = [&] {
    for (const char* program : {"AB/ONE", "AB/TWO", "CD/THREE"}) {
      test::put(folder / (program + std::string("/program.bc")), std::string(1000, 'b'));
      test::put(folder / (program + std::string("/kernel/1-1-1/kernel.so")), std::string(5000, 's'));
      test::put(folder / (program + std::string("/last_accessed")), "");
    }
  };
  make();
  // Files that were written since the last start of the machine are kept, even if they have not been
  // recorded.
  CHECK(opencl::heal_driver_cache(folder.path()) == 0);
  opencl::record_driver_cache(folder.path());
  const fs::path file = folder / "AB/ONE/kernel/1-1-1/kernel.so", code = folder / "CD/THREE/program.bc";
  const auto damage = [&](const fs::path& which, const std::string& content) {
    test::put(which, content);
    CHECK(opencl::heal_driver_cache(folder.path()) == 1);
    CHECK_FALSE(fs::exists(which));
    CHECK(fs::exists(folder / "AB/TWO/program.bc"));
    make();
    opencl::record_driver_cache(folder.path());
    CHECK(opencl::heal_driver_cache(folder.path()) == 0);
  };
  for (const fs::path& which : {file, code}) {
    const std::string whole = test::get(which);
    damage(which, "");
    damage(which, whole.substr(0, whole.size() / 2));
    damage(which, std::string(whole.size(), '\0'));
    std::string bit = whole;
    bit[700] ^= 1;
    damage(which, bit);
  }
  test::put(folder / "EF/NEW/program.bc", "");  // an empty file is removed even if it was never recorded
  CHECK(opencl::heal_driver_cache(folder.path()) == 1);
  // A file that is older than the last start of the machine and was never recorded is removed.
  put_aged(folder / "EF/OLD/program.bc", 10 * 365 * 24h);
  CHECK(opencl::heal_driver_cache(folder.path()) == 1);
  CHECK_FALSE(fs::exists(folder / "EF/OLD"));

  std::string sums = test::get(folder / "sums");
  REQUIRE(sums.find("AB/ONE/program.bc") != std::string::npos);
  // If the list of checksums is damaged, it is created again. The programs are kept, because the test wrote
  // them after the last start of the machine.
  test::put(folder / "sums", sums.substr(0, sums.size() / 2));
  CHECK(opencl::heal_driver_cache(folder.path()) == 0);
  CHECK(test::get(folder / "sums") == sums);
  CHECK(opencl::heal_driver_cache(folder / "missing") == 0);
  CHECK_FALSE(fs::exists(folder / "missing"));
}

TEST_CASE("the cache folder of a process is accessible only to its user, and is the same for every call") {
  const fs::path own = process_cache();
  REQUIRE(fs::is_directory(own));
  CHECK((fs::status(own).permissions() & fs::perms::mask) == fs::perms::owner_all);
  CHECK(process_cache() == own);
}

TEST_CASE("UBS_KERNEL_CACHE selects the folder of compiled kernels, or disables it") {
  const test::TempFolder folder;
  {
    const test::Variable cache("UBS_KERNEL_CACHE", (folder / "k").c_str());
    CHECK(kernel_cache_folder() == folder / "k");
    CHECK(fs::is_directory(folder / "k"));
  }
  const test::Variable off("UBS_KERNEL_CACHE", "off");
  CHECK(kernel_cache_folder().empty());
}

}  // namespace
}  // namespace ubs
