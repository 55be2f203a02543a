// SPDX-License-Identifier: Apache-2.0
// Error is the exception type of the project. Its kind determines the exit code of the command line tool (see
// exit_code()). Its message states the problem, the place, and what the user can do about it. The message is
// a single line, except that a message of kind `build` may also contain the log of the compiler.
#pragma once

#include <fmt/format.h>

#include <array>
#include <stdexcept>
#include <string>
#include <string_view>

namespace ubs {

enum class ErrorKind {
  usage,      // wrong arguments or settings
  data,       // unreadable, corrupt or inconsistent input file
  device,     // no such device, driver failure
  build,      // kernel sources do not compile on this device
  memory,     // predicted or actual lack of memory
  numerical,  // a value that is not finite
  faulty,     // a device that computes wrong results (docs/check.md)
  internal,   // an error in ubs itself: please report it
};

// ExitCode is an exit code of the programs for one kind of error. The library returns it as a status
// (include/ubs/ubs.h), and the Python package has an exception class for it (python/ubs/_errors.py).
struct ExitCode {
  ErrorKind kind;
  int code;
  std::string_view meaning;  // for help texts
};
inline constexpr std::array<ExitCode, 8> kExitCodes{{
    {ErrorKind::internal, 1, "internal error"},
    {ErrorKind::usage, 2, "wrong usage"},
    {ErrorKind::data, 3, "unusable data, or a result that cannot be written"},
    {ErrorKind::device, 4, "device error"},
    {ErrorKind::build, 5, "kernels cannot be built"},
    {ErrorKind::memory, 6, "out of memory"},
    {ErrorKind::numerical, 7, "values that are not finite"},
    {ErrorKind::faulty, 10, "a device computes wrong results"},
}};

// Returns the exit code for this kind of error.
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
