// SPDX-License-Identifier: Apache-2.0
#include "tests/fault/loop_disk.hpp"

#include "tests/support/run_ubs.hpp"

namespace ubs::test {
namespace {

namespace fs = std::filesystem;

void shell(const std::string& command) {
  INFO(command);
  REQUIRE(std::system(command.c_str()) == 0);
}

}  // namespace

LoopDisk::LoopDisk(fs::path mount_point, const std::string& make, int mebibytes, std::string mount)
    : mount_point_(std::move(mount_point)),
      image_(fs::path(mount_point_).concat(".image")),
      pristine_(fs::path(mount_point_).concat(".pristine")),
      mount_(std::move(mount)) {
  fs::create_directories(mount_point_);
  shell(fmt::format("rm -f {1} && truncate -s {0}M {1} && {2} {1} >/dev/null", mebibytes, quoted(pristine_),
                    make));
}

LoopDisk::~LoopDisk() {
  try {
    unmount();
  } catch (...) {
    WARN(mount_point_ << " could not be unmounted");
  }
}

bool LoopDisk::possible() {
  static const bool can = [] {
    const TempFolder folder;
    return run_command(
               folder,
               "truncate -s 8M image && mkfs.ext4 -q image && mkdir mount && mount -o loop image mount "
               "&& umount mount")
               .code == 0;
  }();
  return can;
}

void LoopDisk::mount() {
  shell(fmt::format("device=$(losetup -f --show {}) && {} $device {} >/dev/null", quoted(image_), mount_,
                    quoted(mount_point_)));
  mounted_ = true;
}

void LoopDisk::unmount() {
  if (!mounted_) return;
  shell(fmt::format("umount {} && losetup -d $(losetup -n -O NAME -j {})", quoted(mount_point_),
                    quoted(image_)));
  mounted_ = false;
}

void LoopDisk::format() {
  unmount();
  shell(fmt::format("cp --sparse=always {} {}", quoted(pristine_), quoted(image_)));
  mount();
}

void LoopDisk::sync() { shell(fmt::format("sync -f {}", quoted(mount_point_))); }

void LoopDisk::cut_power() {
  const fs::path copy = fs::path(image_).concat("-copy");
  shell(fmt::format("cp --sparse=always {} {}", quoted(image_), quoted(copy)));
  unmount();
  fs::rename(copy, image_);
  mount();
}

}  // namespace ubs::test
