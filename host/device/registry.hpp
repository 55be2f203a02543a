// SPDX-License-Identifier: Apache-2.0
// Lists the compute devices of all back ends and platforms, and chooses from this list.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host/base/environment.hpp"
#include "host/device/operations.hpp"

namespace ubs {

// Returns all devices, those of CUDA first. So a GPU that both CUDA and OpenCL report is used through CUDA,
// whether it is chosen by default or by a part of its name.
std::vector<DeviceInfo> list_devices();

// Returns the index in the list for a request. A request is one of: an index ("0"); a type ("cpu", "gpu"); a
// back end ("cuda", "opencl"), which means its first GPU or otherwise its first device; or a case-insensitive
// part of the platform, vendor or device name. "cuda:" or "opencl:" before a type or name restricts the
// search to that back end. An empty request uses the environment variable UBS_DEVICE if it is set, otherwise
// the first GPU, otherwise the first device. Throws Error(device) with a list of the devices if nothing
// matches.
std::size_t choose_device(const std::vector<DeviceInfo>& devices, const std::string& request);
// Returns a list that starts with the index that choose_device() returns. If neither the request nor
// UBS_DEVICE names a device, the list also contains the devices to try if that device cannot be used.
std::vector<std::size_t> device_candidates(const std::vector<DeviceInfo>& devices,
                                           const std::string& request);

std::unique_ptr<Device> open_device(std::size_t index);
std::unique_ptr<Device> open_device(const std::string& request = "");

// After this call, ubs starts no processes and catches no signals on behalf of drivers. It is for use inside
// programs other than ubs.
void leave_drivers_alone();

// Lets drivers store compiled kernels in kernel_cache_folder() (host/base/cache_folder.hpp). Some drivers
// read the folder only from the environment; `set` is called for them when devices are listed for the first
// time. Only an executable may call this function, never the library, because the environment belongs to the
// whole process.
void keep_driver_caches(SetVariable set);

// A back end. Tests register one that is not built in; its devices are last in the list.
struct Backend {
  std::function<std::vector<DeviceInfo>()> list_devices;
  std::function<std::unique_ptr<Device>(std::size_t)> open_device;
};
void register_backend(Backend backend);

}  // namespace ubs
