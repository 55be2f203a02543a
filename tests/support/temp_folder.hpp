// SPDX-License-Identifier: Apache-2.0
// Test support: a folder below the system's temporary folder that disappears with the object, and
// short ways to write files and to check an error message.
#pragma once

#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "host/base/error.hpp"

namespace ubs::test {

class TempFolder {
 public:
  TempFolder() {
    static std::atomic<int> counter{0};
    path_ = std::filesystem::temp_directory_path() / fmt::format("ubs-test-{}-{}", ::getpid(), counter++);
    std::filesystem::create_directories(path_);
  }
  ~TempFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline void put(const std::filesystem::path& path, const std::string& content) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << content;
}

inline std::string get(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

inline std::size_t file_count(const std::filesystem::path& folder) {
  return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder), {}));
}

// The message of the Error that `action` throws; empty when it throws none.
template <typename Action>
std::string message_of(const Action& action, ErrorKind expected = ErrorKind::data) {
  try {
    action();
  } catch (const Error& error) {
    CHECK(error.kind() == expected);
    CHECK(std::string(error.what()).find('\n') == std::string::npos);
    return error.what();
  }
  return "";
}

// Real data sets are not part of the repository; a test that wants one says loudly when it is absent.
inline std::filesystem::path real_data(const std::string& name) {
  const char* override_path = std::getenv("UBS_TEST_DATA");
  const std::filesystem::path root =
      override_path ? override_path : std::filesystem::path(UBS_SOURCE_DIR) / ".." / "shared" / "data";
  if (std::filesystem::exists(root / name)) return root / name;
  WARN("SKIPPED: data set " << name << " not found in " << root.string() << " (set UBS_TEST_DATA)");
  return {};
}

}  // namespace ubs::test
