// SPDX-License-Identifier: Apache-2.0
// FolderLock locks a folder of results against other processes that would write there. It locks the file
// ".ubs-lock" in this folder. The file says which process has the lock. The system releases the lock when
// that process ends.
#pragma once

#include <filesystem>

namespace ubs {

class FolderLock {
 public:
  // Creates the folder if it is missing, and removes it at the end if it is still empty. Throws Error(usage),
  // naming the holder, if another process has the lock. On file systems without locks it prints a warning and
  // does not lock.
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
