// SPDX-License-Identifier: Apache-2.0
// Lists and opens the CUDA devices of this machine. Without an NVIDIA driver, the list is empty, and this is
// not an error. The program also starts without a driver, because the CUDA runtime library is linked
// statically and looks for the driver at its first call.
#pragma once

#include <memory>
#include <vector>

#include "host/device/device.hpp"

namespace ubs::cuda {

std::vector<DeviceInfo> list_devices();

// Opens a device by its index in list_devices().
std::unique_ptr<Device> open_device(std::size_t index);

}  // namespace ubs::cuda
