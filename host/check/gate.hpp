// SPDX-License-Identifier: Apache-2.0
// The device for a command, after it has shown once that it computes what the command needs: the first time
// that a device, driver and build come together it is checked, later its verdict is read.
#pragma once

#include <functional>

#include "host/check/subject.hpp"

namespace ubs::check {

struct Use {
  std::function<std::vector<KernelConfig>(const DeviceInfo&)> configs;  // all of them are checked
  Parts parts;
};

struct Gate {
  std::string build;  // names the executable
  // Before a check, which takes seconds, and much longer where kernels have to be compiled; and a warning
  // about devices that are passed over.
  std::function<void(const DeviceInfo&)> on_check;
  std::function<void(const std::string&)> on_warning;
};

// Place in list_devices(). A device that the request names is taken or refused: throws Error(faulty) with
// stage and numbers where it computes wrong results, else what the device throws. Without a request the next
// one is taken, with one warning that says why; throws as for the first one where none is left. With
// UBS_CHECK=off nothing is checked.
std::size_t choose_proved_device(const std::string& request, const Use& use, const Gate& gate);

// The same of one device that has been chosen: throws Error(faulty), or what the device throws.
void prove_device(const DeviceInfo& info, std::size_t index, const Use& use, const Gate& gate);

}  // namespace ubs::check
