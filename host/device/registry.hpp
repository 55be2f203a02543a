// SPDX-License-Identifier: Apache-2.0
// These functions list the compute devices of all back ends and platforms, and choose and open one of them.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host/base/environment.hpp"
#include "host/device/operations.hpp"

namespace ubs {

// Returns all devices, first those of the CUDA back end. Therefore a GPU that both back ends list is used
// through CUDA if it is chosen by default or by a part of its name.
std::vector<DeviceInfo> list_devices();

// Returns the index of the device that `request` selects. A request is one of these:
//   an index in the list, for example "0"
//   a type: "cpu", "gpu" or "accelerator"
//   a back end: for example "cuda" selects its first GPU, or its first device if it has no GPU
//   a part of the name of the platform, the vendor or the device, in upper or lower case
// The name of a back end and a colon ("cuda:") before an index, a type or a name restrict the search to this
// back end. If the request is empty, the environment variable UBS_DEVICE is used as the request. If it is not
// set either, the first GPU is selected, or the first device if there is no GPU. Throws Error(device) with a
// list of the devices if no device matches.
std::size_t choose_device(const std::vector<DeviceInfo>& devices, const std::string& request);
// Returns a list of indices that starts with the index that choose_device() returns. If neither the request
// nor UBS_DEVICE selects a device, the list also contains all other devices, which callers try if the first
// one cannot be used.
std::vector<std::size_t> device_candidates(const std::vector<DeviceInfo>& devices,
                                           const std::string& request);

std::unique_ptr<Device> open_device(std::size_t index);
std::unique_ptr<Device> open_device(const std::string& request = "");

// After this call, ubs does not start processes and does not catch signals to detect failures of drivers. The
// library calls this function, because it must not do either inside of other programs.
void leave_drivers_alone();

// Makes drivers store compiled kernels in kernel_cache_folder() (host/base/cache_folder.hpp). Some drivers
// only read the folder from environment variables. For these drivers, `set` is called to set the variables
// when devices are listed for the first time. Only the executable may call this function, and not the
// library, because the environment belongs to the whole process.
void keep_driver_caches(SetVariable set);

// Backend is a row of the table of back ends (registry.cpp); host/device/backend.hpp describes all that a
// back end provides. Tests register additional back ends, whose devices are at the end of the list.
struct Backend {
  std::string name;  // in lower case; DeviceInfo::backend of its devices, and the word that selects them
  // If a build does not contain the back end, its row has only the name. So the name never selects a device
  // of another back end that is called similarly.
  std::function<std::vector<DeviceInfo>()> list_devices = {};
  std::function<std::unique_ptr<Device>(std::size_t)> open_device = {};
  // Implementations of leave_drivers_alone() and keep_driver_caches(), if the back end needs them.
  std::function<void()> leave_drivers_alone = {};
  std::function<void(SetVariable)> keep_driver_caches = {};
};
void register_backend(Backend backend);

}  // namespace ubs
