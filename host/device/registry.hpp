// SPDX-License-Identifier: Apache-2.0
// The one flat list of compute devices over all back ends and platforms, and choosing from it.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host/device/ceilings.hpp"
#include "host/device/metric_ops.hpp"
#include "host/device/stages.hpp"

namespace ubs {

// All devices, CUDA's first: a card that CUDA and OpenCL both show is taken through CUDA, whether it is
// chosen by itself or by a part of its name.
std::vector<DeviceInfo> list_devices();

// Position in the list for a request: an index ("0"), a type ("cpu", "gpu"), a back end ("cuda", "opencl":
// its first GPU, else its first device), or a case-insensitive part of platform, vendor or device name; after
// "cuda:" or "opencl:" a type or name is looked for in that back end only. Empty: the environment variable
// UBS_DEVICE, else the first GPU, else the first device. Throws Error(device) listing what there is when
// nothing matches.
std::size_t choose_device(const std::vector<DeviceInfo>& devices, const std::string& request);
// The same, and where neither a request nor UBS_DEVICE names one, after it those to try when it is of no use.
std::vector<std::size_t> device_candidates(const std::vector<DeviceInfo>& devices,
                                           const std::string& request);

std::unique_ptr<Device> open_device(std::size_t index);
std::unique_ptr<Device> open_device(const std::string& request = "");

// What the device can do at most. Throws Error(device) where its back end cannot measure it.
CeilingRates measure_ceilings(Device& device, const CeilingLimits& limits);

// The stages of a device, specialised for a configuration.
std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config);

// A back end: what it offers, and the stages of its devices (null for a device of another back end). Tests
// register one that is not built in; its devices come last.
struct Backend {
  std::function<std::vector<DeviceInfo>()> list_devices;
  std::function<std::unique_ptr<Device>(std::size_t)> open_device;
  std::function<std::unique_ptr<Stages>(Device&, const KernelConfig&)> make_stages;
  std::function<std::unique_ptr<MetricOps>(Device&)> make_metric_ops;  // may be missing: no LPIPS then
  std::function<std::unique_ptr<CeilingKernels>(Device&)>
      make_ceiling_kernels;  // may be missing: no benchmarks then
};
void register_backend(Backend backend);

// "cpu", "gpu", or "auto": what suits the device, pixel blocks with explicit vectors on CPUs, else one
// work-item a pixel.
RasterKind raster_kind(const std::string& choice, const DeviceInfo& info);

}  // namespace ubs
