// SPDX-License-Identifier: Apache-2.0
// The OpenCL devices of this machine.
#pragma once

#include <memory>
#include <vector>

#include "host/device/device.hpp"
#include "host/device/stages.hpp"

namespace ubs::opencl {

// All devices of all platforms in the loader's order; platforms without devices are skipped.
std::vector<DeviceInfo> list_devices();

// Opens a device by its place in list_devices(). A vector width other than 0 replaces the device's own: kernels
// for the widths of other machines can so be tested anywhere.
std::unique_ptr<Device> open_device(std::size_t index, unsigned float_vector_width = 0);

// Null when the device is not one of ours.
std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config);

}  // namespace ubs::opencl
