// SPDX-License-Identifier: Apache-2.0
// Creates the operations that a device provides, independent of its back end.
#pragma once

#include <memory>
#include <string>

#include "host/device/metric_ops.hpp"
#include "host/device/stages.hpp"

namespace ubs {

// Returns the stages of a device, specialised for a configuration. Throws Error(usage) for an unsupported
// configuration.
std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config);

// Converts a choice of "cpu", "gpu" or "auto". RasterKind::cpu processes pixel blocks with explicit vectors,
// RasterKind::gpu one pixel per work-item. "auto" selects RasterKind::cpu if the device has vectors of floats
// (float_vector_width > 1), otherwise RasterKind::gpu. Throws Error(usage) for any other choice, and for
// "cpu" with CUDA, which only has RasterKind::gpu.
RasterKind raster_kind(const std::string& choice, const DeviceInfo& info);

}  // namespace ubs
