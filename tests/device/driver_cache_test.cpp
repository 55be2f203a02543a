// SPDX-License-Identifier: Apache-2.0
// The folder of compiled kernels: tried before it is used, and tidied of what PoCL leaves behind.
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

TEST_CASE("PoCL's orphaned files and unused programs are removed, and nothing else") {
  const test::TempFolder folder;
  put_aged(folder / "tempfile_old", 1h);
  put_aged(folder / "tempfile_old.so.o", 1h);
  put_aged(folder / "tempfile_new", 1min);
  put_aged(folder / "other", 10000h);
  put_aged(folder / "AB/UNUSED/last_accessed", 100 * 24h);
  put_aged(folder / "AB/UNUSED/kernel/1-1-1/kernel.so", 100 * 24h);
  put_aged(folder / "AB/USED/last_accessed", 80 * 24h);
  put_aged(folder / "AB/USED/program.bc", 200 * 24h);
  put_aged(folder / "CD/EMPTY/program.bc", 200 * 24h);  // on its way: no last_accessed yet
  opencl::tidy_driver_cache(folder.path());
  CHECK_FALSE(fs::exists(folder / "tempfile_old"));
  CHECK_FALSE(fs::exists(folder / "tempfile_old.so.o"));
  CHECK(fs::exists(folder / "tempfile_new"));
  CHECK(fs::exists(folder / "other"));
  CHECK_FALSE(fs::exists(folder / "AB/UNUSED"));
  CHECK(fs::exists(folder / "AB/USED/program.bc"));
  CHECK(fs::exists(folder / "CD/EMPTY/program.bc"));
  // Programs are looked at once a day.
  put_aged(folder / "AB/UNUSED/last_accessed", 100 * 24h);
  opencl::tidy_driver_cache(folder.path());
  CHECK(fs::exists(folder / "AB/UNUSED"));
  opencl::tidy_driver_cache(folder / "missing");
  CHECK_FALSE(fs::exists(folder / "missing"));
}

TEST_CASE("a cache folder is made and tried; the temporary one belongs to this user alone") {
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
  REQUIRE(::chmod(own.c_str(), 0777) == 0);  // as somebody else might have made it
  CHECK(temporary_cache().empty());
  fs::remove(own);
  fs::create_directory_symlink(folder / "a", own);
  CHECK(temporary_cache().empty());
}

TEST_CASE("UBS_KERNEL_CACHE names the folder of compiled kernels, or none") {
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
