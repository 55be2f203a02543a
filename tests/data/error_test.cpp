// SPDX-License-Identifier: Apache-2.0
// Tests that exceptions of other libraries are converted to ubs::Error with the documented exit code.
#include "host/base/error.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <new>
#include <system_error>

#include "host/base/paths.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using Catch::EndsWith;
using Catch::StartsWith;

TEST_CASE("an exception of any type becomes an error with its exit code") {
  const Error own(ErrorKind::device, "the driver is gone");
  CHECK(exit_code(as_error(own).kind()) == 4);
  CHECK(as_error(own).what() == std::string("the driver is gone"));
  CHECK(exit_code(as_error(std::bad_alloc()).kind()) == 6);
  CHECK(exit_code(as_error(std::bad_array_new_length()).kind()) == 6);
  const std::system_error thread(std::make_error_code(std::errc::resource_unavailable_try_again));
  CHECK(exit_code(as_error(thread).kind()) == 6);
  CHECK(std::string(as_error(thread).what()).find("thread") != std::string::npos);
  CHECK(exit_code(as_error(std::system_error(std::make_error_code(std::errc::io_error))).kind()) == 1);
  CHECK(exit_code(as_error(std::out_of_range("x")).kind()) == 1);
}

// Returns the message of the exception of std::filesystem that `action` throws, after the conversion to
// Error.
template <typename Action>
std::string file_system_message(const Action& action) {
  try {
    action();
  } catch (const fs::filesystem_error& exception) {
    const Error error = as_error(exception);
    CHECK(exit_code(error.kind()) == 3);
    return error.what();
  }
  return "";
}

TEST_CASE("an error of std::filesystem is reported with the paths, the operation and the reason") {
  const test::TempFolder folder;
  const fs::path file = folder / "file", other = folder / "none" / "other";
  test::put(file, "abc");
  REQUIRE(is_regular(file));
  fs::remove(file);  // as another process could do, after ubs has found the file
  CHECK_THAT(file_system_message([&] { static_cast<void>(fs::file_size(file)); }),
             StartsWith(file.string() + ": ") && Contains("size") && EndsWith(": No such file or directory"));
  CHECK_THAT(file_system_message([&] { fs::rename(file, other); }),
             StartsWith(file.string() + " and " + other.string() + ": ") && Contains("rename") &&
                 EndsWith(": No such file or directory"));
  CHECK_THAT(file_system_message([] { static_cast<void>(fs::absolute("")); }),  // an error without a path
             !StartsWith(":") && Contains("absolute") && EndsWith(": Invalid argument"));
  const std::string text = file_system_message([&] { fs::remove(folder / std::string(5000, 'x')); });
  CHECK_THAT(text, Contains("remove") && EndsWith(": File name too long"));
  CHECK(text.size() < 3000);
}

}  // namespace
}  // namespace ubs
