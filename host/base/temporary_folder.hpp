// SPDX-License-Identifier: Apache-2.0
// TemporaryFolder creates a new folder in the folder of the system for temporary files. The destructor
// removes it with all of its contents.
#pragma once

#include <stdlib.h>

#include <filesystem>
#include <string>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"

namespace ubs {

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (temporary_folder() / "ubs-temporary-XXXXXX").string();
    if (!mkdtemp(pattern.data()))
      fail(ErrorKind::data, "{}: cannot make a temporary folder", temporary_folder().string());
    path_ = pattern;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace ubs
