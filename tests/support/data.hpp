// SPDX-License-Identifier: Apache-2.0
// test_data() finds real data for tests, in the folder UBS_TEST_DATA or beside that folder. The default is
// ../shared/data next to the checkout. These data are not part of the project. If they are missing, a test
// prints a warning and skips the part that needs them. Tests that train on them for more than a few seconds
// run only with UBS_TEST_ALL (whole_sweep.hpp).
#pragma once

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

namespace ubs::test {

inline std::optional<std::filesystem::path> test_data(const std::string& name) {
  const char* variable = std::getenv("UBS_TEST_DATA");
  const std::filesystem::path root =
      variable && *variable ? variable : std::filesystem::path(UBS_SOURCE_DIR) / ".." / "shared" / "data";
  for (const std::filesystem::path& folder : {root, root / ".."})
    if (std::filesystem::exists(folder / name)) return folder / name;
  return std::nullopt;
}

}  // namespace ubs::test

// In a test, defines `variable` as the folder of the data set, or leaves the test with a warning.
#define UBS_REQUIRE_DATA(variable, name)                                                           \
  const auto variable##_found = ubs::test::test_data(name);                                        \
  if (!variable##_found) {                                                                         \
    WARN("SKIPPED: no test data '" << name << "'; set UBS_TEST_DATA to the folder that holds it"); \
    return;                                                                                        \
  }                                                                                                \
  const std::filesystem::path variable = *variable##_found
