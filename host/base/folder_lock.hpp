// SPDX-License-Identifier: Apache-2.0
// Holds a folder of results against other processes that would write there, by a lock that the system removes
// with its holders: a file ".ubs-lock" in the folder, which says who holds it.
#pragma once

#include <filesystem>

namespace ubs {

class FolderLock {
 public:
  // Creates the folder if it is missing, and removes it at the end if it is still empty. Throws Error(usage)
  // that names the holder if another process has the lock. On file systems without locks there is a warning
  // and no lock.
  explicit FolderLock(std::filesystem::path folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  bool try_once();

  std::filesystem::path folder_, path_;
  int file_ = -1;
  bool made_ = false;
};

}  // namespace ubs
