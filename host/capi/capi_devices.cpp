// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for devices.
#include "host/capi/handles.hpp"
#include "host/device/registry.hpp"

namespace ubs::facade {
namespace {

// Lists the devices. Also calls leave_drivers_alone(), which must be called before the first use of a driver.
// This is the right place, because no function of the C interface can use a driver before devices are listed.
std::vector<DeviceInfo> devices_here() {
  leave_drivers_alone();
  return list_devices();
}

ubs_device_info info_of(const DeviceInfo& device) {
  ubs_device_info info{};
  put_text(info.backend, device.backend);
  put_text(info.platform, device.platform);
  put_text(info.vendor, device.vendor);
  put_text(info.name, device.name);
  put_text(info.driver, device.driver);
  info.type = device.type == DeviceType::cpu   ? UBS_DEVICE_CPU
              : device.type == DeviceType::gpu ? UBS_DEVICE_GPU
                                               : UBS_DEVICE_ACCELERATOR;
  info.compute_units = device.compute_units;
  info.memory_bytes = device.memory_bytes;
  info.max_allocation_bytes = device.max_allocation_bytes;
  return info;
}

}  // namespace
}  // namespace ubs::facade

using namespace ubs;
using namespace ubs::facade;

ubs_status ubs_device_count(size_t* count) {
  return guarded([&] { given(count, "count") = devices_here().size(); });
}

ubs_status ubs_device_describe(size_t index, ubs_device_info* info) {
  return guarded([&] {
    const std::vector<DeviceInfo> devices = devices_here();
    if (index >= devices.size())
      fail(ErrorKind::usage, "device {} does not exist: there are {} devices", index, devices.size());
    put(info, info_of(devices[index]), "info");
  });
}

ubs_status ubs_device_open(const char* request, ubs_device** device) {
  return made(device, [&] {
    auto open = std::make_shared<OpenDevice>();
    open->index = choose_device(devices_here(), request ? request : "");
    open->device = open_device(open->index);
    return std::make_unique<ubs_device>(ubs_device{std::move(open)});
  });
}

ubs_status ubs_device_get_info(const ubs_device* device, ubs_device_info* info) {
  return guarded([&] {
    OpenDevice& open = *given(device, "device").open;
    const std::lock_guard lock(open.mutex);
    ubs_device_info values = info_of(open.device->info());
    values.allocated_bytes = open.device->allocated_bytes();
    values.peak_bytes = open.device->peak_bytes();
    put(info, values, "info");
  });
}

void ubs_device_free(ubs_device* device) { delete device; }
