// SPDX-License-Identifier: Apache-2.0
// These functions list and open the OpenCL devices of this machine.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "host/device/device.hpp"

namespace ubs::opencl {

// Returns all devices of all platforms in the order of the loader. Platforms without devices are skipped.
// Platforms and devices whose driver fails are skipped with a warning.
std::vector<DeviceInfo> list_devices();

// Returns the value of the compiler option -cl-std that makes sub-group functions available ("CL3.0" or
// "CL2.0"), or an empty string if the device does not support them. `version` is the version of the device
// ("OpenCL 3.0 ..."). `extensions` and `features` contain the names of its extensions and of its OpenCL C
// features, separated by blanks.
std::string subgroup_language(std::string_view version, std::string_view extensions,
                              std::string_view features);

// Opens a device by its index in list_devices(). A vector width other than 0 replaces that of the device, so
// that kernels for the vector widths of other machines can be tested on any machine.
std::unique_ptr<Device> open_device(std::size_t index, unsigned float_vector_width = 0);

}  // namespace ubs::opencl
