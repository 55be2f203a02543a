// SPDX-License-Identifier: Apache-2.0
// Holds a folder of results against other processes that would write there, by a lock that the system removes
// with its holders: a file ".ubs-lock" in the folder, which says who holds it.
#pragma once

#include <filesystem>

namespace ubs {

class FolderLock {
 public:
  enum class Children {
    without,  // the lock ends with this process
    inherit   // processes that it starts hold it too: it stays until the last of them has gone
  };

  // Makes the folder where it is missing, and removes it at the end if nothing came into it. Waits for
  // `patience` seconds, then throws Error(usage) naming the holder. Where the file system knows no locks
  // there is a warning and no lock.
  explicit FolderLock(std::filesystem::path folder, Children children = Children::without,
                      double patience = 0);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  bool try_once();

  std::filesystem::path folder_, path_;
  Children children_;
  int file_ = -1;
  bool made_ = false;
};

}  // namespace ubs
