// SPDX-License-Identifier: Apache-2.0
#include "tools/common/program_version.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>

#include "host/base/paths.hpp"

namespace ubs::tools {

std::string commit() {
  std::ifstream file(this_executable().concat(".commit"));
  std::string text;
  return file >> text ? text : "unknown";
}

std::string version_line(std::string_view program) {
  return fmt::format("{} {} (build {})", program, version(), build_id());
}

}  // namespace ubs::tools
