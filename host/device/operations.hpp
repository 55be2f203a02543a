// SPDX-License-Identifier: Apache-2.0
// What a device does for the method, whatever its back end.
#pragma once

#include <memory>
#include <string>

#include "host/device/metric_ops.hpp"
#include "host/device/stages.hpp"

namespace ubs {

// The stages of a device, specialised for a configuration. Throws Error(usage) for one that there is not.
std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config);
// Image metrics beyond PSNR and SSIM.
std::unique_ptr<MetricOps> make_metric_ops(Device& device);

// "cpu", "gpu", or "auto": what suits the device, pixel blocks with explicit vectors on CPUs, else one
// work-item a pixel. CUDA has the latter; throws Error(usage) for the other.
RasterKind raster_kind(const std::string& choice, const DeviceInfo& info);

}  // namespace ubs
