// SPDX-License-Identifier: Apache-2.0
// FolderLock prevents two processes from writing their results to the same folder. It locks the file
// ".ubs-lock" in this folder. The file contains the number of the process that has the lock, its machine and
// the time. The operating system releases the lock when this process ends.
#pragma once

#include <filesystem>
#include <vector>

namespace ubs {

class FolderLock {
 public:
  // Creates the folder and the folders above it if they are missing, and locks it. Throws Error(usage) if
  // another process has the lock; the message contains the number of this process. If the file system does
  // not support locks, logs a warning and does not lock. The destructor releases the lock, and removes the
  // folders that the constructor has created and that are still empty.
  // Throws Error(data) if the lock file is not an ordinary file, or has a second name (a hard link), because
  // writing to it would change another file.
  explicit FolderLock(std::filesystem::path folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  // Throws Error(data) if the path of the folder no longer leads to the locked folder, because somebody has
  // removed it or put another folder or a link in its place. Writers must call this function before they
  // write results after a long time. If only the lock file was removed, locks the folder again.
  void check_place();

 private:
  bool try_once();           // returns whether this process now has the lock, or needs none
  bool is_in_place() const;  // returns whether the lock file still has its path, if locks are supported

  std::filesystem::path folder_, path_;
  std::vector<std::filesystem::path> made_;  // folders that did not exist before, the innermost first
  int file_ = -1, folder_file_ = -1;  // the second one keeps the number of the folder from being reused
  bool held_ = false;                 // false if the file system does not support locks
};

}  // namespace ubs
