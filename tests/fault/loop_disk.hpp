// SPDX-License-Identifier: Apache-2.0
// Test support: LoopDisk is a file system in a file. It is mounted from the first call of format() until the
// object is destroyed. A copy of the file has the state of a disk after a power cut, because it does not
// contain data that the kernel has not written yet. When the copy is mounted, ext4 replays its journal.
// LoopDisk requires root and loop devices.
#pragma once

#include <filesystem>
#include <string>

namespace ubs::test {

class LoopDisk {
 public:
  // `mount_point` is the folder at which the file system is mounted. `make` is the command that creates a
  // file system, without the name of the file, such as "mkfs.ext4 -q". `mebibytes` is the size of the file.
  // `mount` is the command that mounts a loop device.
  LoopDisk(std::filesystem::path mount_point, const std::string& make, int mebibytes = 32,
           std::string mount = "mount");
  ~LoopDisk();
  LoopDisk(const LoopDisk&) = delete;
  // Returns whether this process can create a file with an ext4 file system and mount it.
  static bool possible();

  void format();     // creates an empty file system and mounts it
  void sync();       // makes the kernel write all data to the disk
  void cut_power();  // replaces the disk by a copy of what a power cut leaves, and mounts it

 private:
  void mount();
  void unmount();
  std::filesystem::path mount_point_, image_, pristine_;
  std::string mount_;
  bool mounted_ = false;
};

}  // namespace ubs::test
