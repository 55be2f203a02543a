// SPDX-License-Identifier: Apache-2.0
// Error is the exception type of the project. Its kind determines the exit code of the command line tool (see
// exit_code()). Its message states the problem, the place, and what the user can do about it. The message is
// a single line, except that a message of kind `build` may also contain the log of the compiler.
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <string_view>

namespace ubs {

enum class ErrorKind {
  usage,      // wrong arguments or settings                              exit 2
  data,       // unreadable, corrupt or inconsistent input file           exit 3
  device,     // no such device, driver failure                           exit 4
  build,      // kernel sources do not compile on this device             exit 5
  memory,     // predicted or actual lack of memory                       exit 6
  numerical,  // a value that is not finite                               exit 7
  faulty,     // a device that computes wrong results (docs/check.md)     exit 10
  internal,   // an error in ubs itself: please report it                 exit 1
};

// Returns the exit code of the command line tool for this kind of error.
int exit_code(ErrorKind kind);

class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

template <typename... Args>
[[noreturn]] void fail(ErrorKind kind, fmt::format_string<Args...> format, Args&&... args) {
  throw Error(kind, fmt::format(format, std::forward<Args>(args)...));
}

// Converts an exception of any type to an Error. Exceptions that are not an Error get the kind that fits
// them, for example ErrorKind::memory for std::bad_alloc. A std::filesystem::filesystem_error becomes an
// Error(data) with the paths, the operation and the reason. Code that continues after a failed operation of
// std::filesystem must therefore catch std::exception and call as_error(), or use an overload with an
// error_code: `catch (const Error&)` does not catch a filesystem_error.
Error as_error(const std::exception& exception);

}  // namespace ubs
