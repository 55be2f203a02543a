// SPDX-License-Identifier: Apache-2.0
// These functions create the operations of a device. They work in the same way for all back ends.
#pragma once

#include <memory>
#include <string>

#include "host/device/metric_ops.hpp"
#include "host/device/stages.hpp"

namespace ubs {

// Returns the stages of a device, specialised for a configuration. Throws Error(usage) for an unsupported
// configuration.
std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config);

// Returns the kind of rasteriser for a choice, which must be "cpu", "gpu" or "auto". RasterKind::cpu
// processes blocks of pixels with explicit vectors, and RasterKind::gpu processes one pixel per work-item.
// "auto" selects RasterKind::cpu if the device has vectors of floats (float_vector_width > 1), and otherwise
// RasterKind::gpu. Throws Error(usage) for any other choice, and for "cpu" on devices that only support
// RasterKind::gpu.
RasterKind raster_kind(const std::string& choice, const DeviceInfo& info);

}  // namespace ubs
