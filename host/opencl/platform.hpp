// SPDX-License-Identifier: Apache-2.0
// The OpenCL devices of this machine.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "host/device/device.hpp"

namespace ubs::opencl {

// All devices of all platforms in the loader's order; platforms without devices are skipped, those whose
// driver does not answer and single devices that do not with a warning.
std::vector<DeviceInfo> list_devices();

// The -cl-std that makes sub-group functions available: "CL3.0", "CL2.0", or empty when the device has none.
// From the device's version ("OpenCL 3.0 ..."), extensions and OpenCL C features (names between blanks).
std::string subgroup_language(std::string_view version, std::string_view extensions,
                              std::string_view features);

// Opens a device by its place in list_devices(). A vector width other than 0 replaces the device's own:
// kernels for the widths of other machines can so be tested anywhere.
std::unique_ptr<Device> open_device(std::size_t index, unsigned float_vector_width = 0);

}  // namespace ubs::opencl
