// SPDX-License-Identifier: Apache-2.0
// choose_proved_device() selects the device for a command and ensures that it has passed a check of the
// kernels that the command needs. Each combination of device, driver and build is checked once; afterwards
// the stored verdict is used.
#pragma once

#include <functional>

#include "host/check/subject.hpp"

namespace ubs::check {

struct Use {
  // All returned configurations are checked.
  std::function<std::vector<KernelConfig>(const DeviceInfo&)> configs;
  Parts parts;
};

struct Gate {
  std::string build;  // identifies the executable
  // on_check is called before a check, which takes seconds, or much longer if kernels must be compiled.
  // on_warning is called with a warning about devices that are skipped.
  std::function<void(const DeviceInfo&)> on_check;
  std::function<void(const std::string&)> on_warning;
};

// Returns the index of the device in list_devices(). If the request names a device, this device is used or
// refused: the function throws Error(faulty) with stage and numbers if its results are wrong, and otherwise
// the error of the device. Without a request, a device that fails is skipped, with one warning that contains
// the reason. If no device is left, the function throws the error of the first one. With UBS_CHECK=off
// nothing is checked.
std::size_t choose_proved_device(const std::string& request, const Use& use, const Gate& gate);

// Checks one device that has already been chosen. Throws Error(faulty) or the error of the device.
void prove_device(const DeviceInfo& info, std::size_t index, const Use& use, const Gate& gate);

}  // namespace ubs::check
