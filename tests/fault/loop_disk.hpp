// SPDX-License-Identifier: Apache-2.0
// Test support: a file system in a file, mounted for as long as the object lives. What the kernel has not
// written to the file when it is copied is lost in the copy, as by a power cut (ext4 plays its journal back
// when the copy is mounted). Needs root and loop devices.
#pragma once

#include <filesystem>
#include <string>

namespace ubs::test {

class LoopDisk {
 public:
  // `make`: the command that makes a file system, without the name of the file, such as "mkfs.ext4 -q".
  // `mount`: the command that mounts a loop device.
  LoopDisk(std::filesystem::path mount_point, const std::string& make, int mebibytes = 32,
           std::string mount = "mount");
  ~LoopDisk();
  LoopDisk(const LoopDisk&) = delete;
  // Whether ext4 can be mounted here.
  static bool possible();

  void format();     // mounted and empty
  void sync();       // all of it is on the disk
  void cut_power();  // mounted, as it is after a power cut

 private:
  void mount();
  void unmount();
  std::filesystem::path mount_point_, image_, pristine_;
  std::string mount_;
  bool mounted_ = false;
};

}  // namespace ubs::test
