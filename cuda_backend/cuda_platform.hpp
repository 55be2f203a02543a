// SPDX-License-Identifier: Apache-2.0
// The CUDA devices of this machine. Without an NVIDIA driver there are none, and that is no error: the
// runtime library is linked statically and looks for the driver when it is first asked.
#pragma once

#include <memory>
#include <vector>

#include "host/device/device.hpp"

namespace ubs::cuda {

std::vector<DeviceInfo> list_devices();

// Opens a device by its place in list_devices().
std::unique_ptr<Device> open_device(std::size_t index);

}  // namespace ubs::cuda
