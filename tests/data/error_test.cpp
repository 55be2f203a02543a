// SPDX-License-Identifier: Apache-2.0
// Tests that exceptions of other libraries are converted to ubs::Error with the documented exit code.
#include "host/base/error.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <new>
#include <system_error>

namespace ubs {
namespace {

TEST_CASE("an exception of any type becomes an error with its exit code") {
  const Error own(ErrorKind::device, "the driver is gone");
  CHECK(exit_code(as_error(own).kind()) == 4);
  CHECK(as_error(own).what() == std::string("the driver is gone"));
  CHECK(exit_code(as_error(std::bad_alloc()).kind()) == 6);
  CHECK(exit_code(as_error(std::bad_array_new_length()).kind()) == 6);
  const std::filesystem::filesystem_error file("x", "a/b", std::make_error_code(std::errc::io_error));
  CHECK(exit_code(as_error(file).kind()) == 3);
  CHECK(std::string(as_error(file).what()).starts_with("a/b: "));
  const std::system_error thread(std::make_error_code(std::errc::resource_unavailable_try_again));
  CHECK(exit_code(as_error(thread).kind()) == 6);
  CHECK(std::string(as_error(thread).what()).find("thread") != std::string::npos);
  CHECK(exit_code(as_error(std::system_error(std::make_error_code(std::errc::io_error))).kind()) == 1);
  CHECK(exit_code(as_error(std::out_of_range("x")).kind()) == 1);
}

}  // namespace
}  // namespace ubs
