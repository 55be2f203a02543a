// SPDX-License-Identifier: Apache-2.0
// source_folder() returns the folder of the project's sources, for tests that read or copy kernels. On a
// machine that has only the executables, tools/gpu_check.sh sets UBS_TEST_SOURCE to the part of the sources
// that cmake/Portable.cmake installs next to them.
#pragma once

#include <cstdlib>
#include <filesystem>

namespace ubs::test {

inline std::filesystem::path source_folder() {
  const char* variable = std::getenv("UBS_TEST_SOURCE");
  return variable && *variable ? variable : UBS_SOURCE_DIR;
}

}  // namespace ubs::test
