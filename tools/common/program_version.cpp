// SPDX-License-Identifier: Apache-2.0
#include "tools/common/program_version.hpp"

#include <fmt/format.h>

namespace ubs::tools {

std::string version_line(std::string_view program) {
  return fmt::format("{} {} (build {})", program, version(), build_id());
}

}  // namespace ubs::tools
