// SPDX-License-Identifier: Apache-2.0
#include "tests/support/device_fixture.hpp"

#include <cstdio>
#include <cstdlib>

#include "host/base/error.hpp"
#include "tests/cuda/cuda_on_host.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs::test {
namespace {

constexpr int kSkipped = 77;

std::string selected;

bool exists(const std::string& device) {
  try {
    choose_device(list_devices(), device);
    return true;
  } catch (const Error&) {
    return false;
  }
}

}  // namespace

int use_device(const std::string& request, bool optional, bool cuda_on_host) {
  // Makes drivers store their caches in the folder of ubs's own caches.
  keep_driver_caches([](const char* name, const char* value) { setenv(name, value, 1); });
  if (cuda_on_host) register_cuda_on_host();
  selected = cuda_on_host ? "CUDA on the host" : request;
  if (!optional || exists(selected)) return 0;
  std::printf("SKIPPED: there is no device '%s' on this machine\n", selected.c_str());
  return kSkipped;
}

std::vector<std::shared_ptr<Device>> devices_under_test() {
  // The devices are never destroyed, because some drivers are already shut down when static destructors run.
  static const auto* devices = new std::vector<std::shared_ptr<Device>>([] {
    std::vector<std::shared_ptr<Device>> opened;
    const std::vector<DeviceInfo> all = list_devices();
    if (!selected.empty()) {
      opened.push_back(open_device(choose_device(all, selected)));
    } else {
      for (std::size_t i = 0; i < all.size(); ++i) opened.push_back(open_device(i));
    }
    if (opened.empty())
      fail(ErrorKind::device, "no device to test on; install a driver such as pocl-opencl-icd");
    return opened;
  }());
  return *devices;
}

std::vector<std::shared_ptr<Device>> opencl_devices_under_test() {
  std::vector<std::shared_ptr<Device>> devices = devices_under_test();
  std::erase_if(devices, [](const auto& device) { return device->info().backend != "opencl"; });
  return devices;
}

std::vector<RasterKind> rasters_of(const Device& device) {
  if (!device.info().has_cpu_raster) return {RasterKind::gpu};
  return {RasterKind::cpu, RasterKind::gpu};
}

std::vector<std::string> raster_names_of(const Device& device) {
  if (!device.info().has_cpu_raster) return {"gpu"};
  return {"cpu", "gpu"};
}

bool on_host(const Device& device) { return device.info().name == "CUDA on the host" && !whole_sweep(); }

}  // namespace ubs::test
