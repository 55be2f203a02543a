// SPDX-License-Identifier: Apache-2.0
// TemporaryFolder creates a new folder in the folder of the system for temporary files, which is the value of
// the first of the variables TMPDIR, TMP, TEMP and TEMPDIR that is set, or /tmp if none is set. The
// destructor removes the new folder with all of its contents.
#pragma once

#include <stdlib.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>

#include "host/base/error.hpp"

namespace ubs {

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::error_code error;
    const std::filesystem::path system = std::filesystem::temp_directory_path(error);
    if (error)
      fail(ErrorKind::data,
           "{}cannot find the folder for temporary files: {}: set TMPDIR to a writable folder",
           std::getenv("TMPDIR") ? std::getenv("TMPDIR") + std::string(": ") : "", error.message());
    std::string pattern = (system / "ubs-temporary-XXXXXX").string();
    if (!mkdtemp(pattern.data()))
      fail(ErrorKind::data, "{}: cannot make a temporary folder", system.string());
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
