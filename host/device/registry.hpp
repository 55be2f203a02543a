// SPDX-License-Identifier: Apache-2.0
// The one flat list of compute devices over all back ends and platforms, and choosing from it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

// In order of preference: the order in which an unspecified choice is made is GPUs first.
std::vector<DeviceInfo> list_devices();

// Position in the list for a request: an index ("0"), a type ("cpu", "gpu"), or a case-insensitive part
// of platform, vendor or device name. Empty: the environment variable UBS_DEVICE, else the first GPU,
// else the first device. Throws Error(device) listing what there is when nothing matches.
std::size_t choose_device(const std::vector<DeviceInfo>& devices, const std::string& request);

std::unique_ptr<Device> open_device(std::size_t index);
std::unique_ptr<Device> open_device(const std::string& request = "");

// The stages of a device, specialised for a configuration.
std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config);

// "cpu", "gpu", or "auto": what suits the device, pixel blocks with explicit vectors on CPUs, else one
// work-item a pixel.
RasterKind raster_kind(const std::string& choice, const DeviceInfo& info);

}  // namespace ubs
