// SPDX-License-Identifier: Apache-2.0
// FolderLock locks a folder of results against other processes that would write there. It locks the file
// ".ubs-lock" in this folder. The file says which process has the lock. The system releases the lock when
// that process ends.
#pragma once

#include <filesystem>
#include <vector>

namespace ubs {

class FolderLock {
 public:
  // Creates the folder and the folders above it if they are missing. The destructor removes those of them
  // that are still empty. Throws Error(usage), naming the holder, if another process has the lock. On file
  // systems without locks it prints a warning and does not lock.
  explicit FolderLock(std::filesystem::path folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  bool try_once();

  std::filesystem::path folder_, path_;
  std::vector<std::filesystem::path> made_;  // folders that did not exist before, the innermost first
  int file_ = -1;
};

}  // namespace ubs
