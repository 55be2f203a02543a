// SPDX-License-Identifier: Apache-2.0
// The CUDA devices of this machine. Without an NVIDIA driver there are none, and that is no error: the
// runtime library is linked statically and looks for the driver when it is first asked.
#pragma once

#include <memory>
#include <vector>

#include "host/device/ceilings.hpp"
#include "host/device/metric_ops.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

std::vector<DeviceInfo> list_devices();

// Opens a device by its place in list_devices().
std::unique_ptr<Device> open_device(std::size_t index);

// Null when the device is not one of ours.
std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config);
std::unique_ptr<MetricOps> make_metric_ops(Device& device);
std::unique_ptr<CeilingKernels> make_ceiling_kernels(Device& device);

}  // namespace ubs::cuda
