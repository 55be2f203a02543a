// SPDX-License-Identifier: Apache-2.0
// Real data for tests: UBS_TEST_DATA, else ../shared/data beside the checkout. They are not part of the
// project; where they are missing a test says so loudly and passes over them. Tests that train on them run
// with UBS_TEST_ALL alone (whole_sweep.hpp).
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
  if (std::filesystem::exists(root / name)) return root / name;
  return std::nullopt;
}

}  // namespace ubs::test

// In a test: folder of the data set, or leave the test with a warning.
#define UBS_REQUIRE_DATA(variable, name)                                                           \
  const auto variable##_found = ubs::test::test_data(name);                                        \
  if (!variable##_found) {                                                                         \
    WARN("SKIPPED: no test data '" << name << "'; set UBS_TEST_DATA to the folder that holds it"); \
    return;                                                                                        \
  }                                                                                                \
  const std::filesystem::path variable = *variable##_found
