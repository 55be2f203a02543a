// SPDX-License-Identifier: Apache-2.0
// The one flat list of compute devices over all back ends and platforms, and choosing from it.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host/base/environment.hpp"
#include "host/device/operations.hpp"

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

// Starts no process and catches no signal for drivers from now on: in a program that is not ours.
void leave_drivers_alone();

// Lets drivers keep compiled kernels in kernel_cache_folder() (host/base/cache_folder.hpp), which some are
// told only through the environment: `set` is called when devices are listed first. To be called by an
// executable, never by the library, because the environment belongs to the whole process.
void keep_driver_caches(SetVariable set);

// A back end. Tests register one that is not built in; its devices come last.
struct Backend {
  std::function<std::vector<DeviceInfo>()> list_devices;
  std::function<std::unique_ptr<Device>(std::size_t)> open_device;
};
void register_backend(Backend backend);

}  // namespace ubs
