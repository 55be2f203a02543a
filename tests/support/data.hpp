// SPDX-License-Identifier: Apache-2.0
// test_data() finds data sets and files of other tools for tests. They are not part of the project. The
// environment variable UBS_TEST_DATA is the path of a folder. The data are in this folder or in its parent
// folder. If the variable is not set, the folder is shared/data next to the folder of the project. If the
// data are missing, a test prints a warning and skips the part that needs them. Tests that train on these
// data for more than a few seconds only run with UBS_TEST_ALL (whole_sweep.hpp).
#pragma once

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

namespace ubs::test {

// Returns the path of the data with this name, or nothing if they do not exist.
inline std::optional<std::filesystem::path> test_data(const std::string& name) {
  const char* variable = std::getenv("UBS_TEST_DATA");
  const std::filesystem::path root =
      variable && *variable ? variable : std::filesystem::path(UBS_SOURCE_DIR) / ".." / "shared" / "data";
  for (const std::filesystem::path& folder : {root, root / ".."})
    if (std::filesystem::exists(folder / name)) return folder / name;
  return std::nullopt;
}

}  // namespace ubs::test

// This macro is used in a test case. It defines `variable` as the path of the data with this name. If the
// data do not exist, it prints a warning and returns from the test case.
#define UBS_REQUIRE_DATA(variable, name)                                                           \
  const auto variable##_found = ubs::test::test_data(name);                                        \
  if (!variable##_found) {                                                                         \
    WARN("SKIPPED: no test data '" << name << "'; set UBS_TEST_DATA to the folder that holds it"); \
    return;                                                                                        \
  }                                                                                                \
  const std::filesystem::path variable = *variable##_found
