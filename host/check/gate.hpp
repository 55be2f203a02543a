// SPDX-License-Identifier: Apache-2.0
// choose_verified_device() selects the device for a command, and ensures that this device has passed a check
// of the kernels that the command needs. For each combination of device, driver and build, each variant of
// the method is checked once. Afterwards the stored verdict is used.
#pragma once

#include <functional>

#include "host/check/subject.hpp"

namespace ubs::check {

// Use describes the kernels that a command needs.
struct Use {
  // Returns the kernel configurations that the command uses on a device. All of them are checked.
  std::function<std::vector<KernelConfig>(const DeviceInfo&)> configs;
  Parts parts;
};

struct Gate {
  std::string build;  // identifies the executable
  // on_check is called before a check. A check takes seconds, or much longer if kernels must be compiled.
  // on_warning is called with a warning about devices that are skipped.
  std::function<void(const DeviceInfo&)> on_check;
  std::function<void(const std::string&)> on_warning;
};

// Returns the index of the selected device in list_devices(). If `request` or the environment variable
// UBS_DEVICE selects a device and this device computes wrong results, the function throws Error(faulty),
// whose message contains the stage and the error. If the device fails otherwise, the function throws the
// error of the device. If neither selects a device, devices that fail are skipped, with one warning that
// contains the reasons; if all devices fail, the function throws the error of the first one. Error(memory) is
// thrown in any case, because a lack of memory may be temporary. If the environment variable UBS_CHECK is
// "off", nothing is checked.
std::size_t choose_verified_device(const std::string& request, const Use& use, const Gate& gate);

// Checks a device that has already been chosen. Throws Error(faulty) if it computes wrong results. If the
// device fails otherwise, throws the error of the device.
void verify_device(const DeviceInfo& info, std::size_t index, const Use& use, const Gate& gate);

}  // namespace ubs::check
