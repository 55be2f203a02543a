// SPDX-License-Identifier: Apache-2.0
#include "host/base/error.hpp"

#include <filesystem>
#include <new>
#include <system_error>

#include "host/base/text.hpp"

namespace ubs {

int exit_code(ErrorKind kind) {
  for (const ExitCode& row : kExitCodes)
    if (row.kind == kind) return row.code;
  return 1;  // never reached, because the table contains all kinds
}

Error as_error(const std::exception& exception) {
  if (const auto* error = dynamic_cast<const Error*>(&exception))
    return error->kind() == ErrorKind::build ? *error : Error(error->kind(), shortened(error->what()));
  if (dynamic_cast<const std::bad_alloc*>(&exception))
    return {ErrorKind::memory,
            "out of memory: use fewer splats, smaller images (--downscale) or fewer views"};
  // The functions of host/base/paths.hpp should have converted this exception already.
  if (const auto* error = dynamic_cast<const std::filesystem::filesystem_error*>(&exception))
    return {ErrorKind::data, fmt::format("{}: {}", error->path1().string(), error->code().message())};
  if (const auto* error = dynamic_cast<const std::system_error*>(&exception))
    if (error->code() == std::errc::resource_unavailable_try_again)  // thrown by std::thread
      return {ErrorKind::memory,
              "the system does not allow this process to create another thread: raise the limit on processes "
              "(ulimit -u, or that of the container) or the limit on memory"};
  return {ErrorKind::internal, fmt::format("internal: {}", shortened(exception.what()))};
}

}  // namespace ubs
