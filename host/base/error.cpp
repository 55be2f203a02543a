// SPDX-License-Identifier: Apache-2.0
#include "host/base/error.hpp"

#include <algorithm>
#include <filesystem>
#include <new>
#include <system_error>

#include "host/base/text.hpp"

namespace ubs {
namespace {

constexpr bool has_all_kinds() {
  for (int kind = 0; kind <= static_cast<int>(ErrorKind::internal); ++kind)
    if (std::ranges::count(kExitCodes, static_cast<ErrorKind>(kind), &ExitCode::kind) != 1) return false;
  return true;
}
static_assert(has_all_kinds(), "kExitCodes must have one row for each kind of error");

// Returns the paths, the operation and the reason, for example "a/b: cannot get file size: No such file or
// directory" or "a and b: cannot rename: Permission denied". The function what() of the base class returns
// only the operation and the reason. Some operations have no path, such as finding the current folder.
std::string file_system_text(const std::filesystem::filesystem_error& error) {
  std::string text = error.path1().string();
  if (!error.path2().empty()) text += " and " + error.path2().string();
  return text + (text.empty() ? "" : ": ") + error.std::system_error::what();
}

}  // namespace

int exit_code(ErrorKind kind) { return std::ranges::find(kExitCodes, kind, &ExitCode::kind)->code; }

Error as_error(const std::exception& exception) {
  if (const auto* error = dynamic_cast<const Error*>(&exception))
    return error->kind() == ErrorKind::build ? *error : Error(error->kind(), shortened(error->what()));
  if (dynamic_cast<const std::bad_alloc*>(&exception))
    return {ErrorKind::memory,
            "out of memory: use fewer splats, smaller images (--downscale) or fewer views"};
  if (const auto* error = dynamic_cast<const std::filesystem::filesystem_error*>(&exception))
    return {ErrorKind::data, shortened(file_system_text(*error))};
  if (const auto* error = dynamic_cast<const std::system_error*>(&exception))
    if (error->code() == std::errc::resource_unavailable_try_again)  // thrown by std::thread
      return {ErrorKind::memory,
              "the system does not allow this process to create another thread: raise the limit on processes "
              "(ulimit -u, or that of the container) or the limit on memory"};
  return {ErrorKind::internal, fmt::format("internal: {}", shortened(exception.what()))};
}

}  // namespace ubs
