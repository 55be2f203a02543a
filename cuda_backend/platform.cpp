// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/platform.hpp"

#include "cuda_backend/cuda_device.hpp"

namespace ubs::cuda {
namespace {

constexpr int kOldestMajor = 7, kOldestMinor = 5;  // sm_75, the oldest that CUDA 13 compiles for

std::string version_text(int version) { return fmt::format("{}.{}", version / 1000, version % 1000 / 10); }

DeviceInfo describe_device(const cudaDeviceProp& properties, int driver, int runtime) {
  DeviceInfo info;
  info.backend = "cuda";
  info.platform = fmt::format("CUDA runtime {}", version_text(runtime));
  info.vendor = "NVIDIA";
  info.name = properties.name;
  info.driver = fmt::format("CUDA {}", version_text(driver));
  info.pci = fmt::format("{:04x}:{:02x}:{:02x}.0", properties.pciDomainID, properties.pciBusID,
                         properties.pciDeviceID);
  info.version = fmt::format("sm_{}{}", properties.major, properties.minor);
  info.type = DeviceType::gpu;
  info.memory_bytes = properties.totalGlobalMem;
  info.max_allocation_bytes = properties.totalGlobalMem;
  info.compute_units = static_cast<unsigned>(properties.multiProcessorCount);
  info.float_vector_width = 1;
  info.has_double = true;
  info.tuning = load_tuning(info, tuned_constants());
  return info;
}

struct Entry {
  int ordinal;
  DeviceInfo info;
};

// Any failure to ask (no driver, a driver too old, no permission) means that there is nothing to offer.
std::vector<Entry> entries() {
  std::vector<Entry> all;
  int count = 0, driver = 0, runtime = 0;
  if (cudaGetDeviceCount(&count) != cudaSuccess || cudaDriverGetVersion(&driver) != cudaSuccess ||
      cudaRuntimeGetVersion(&runtime) != cudaSuccess) {
    cudaGetLastError();
    return all;
  }
  for (int ordinal = 0; ordinal < count; ++ordinal) {
    cudaDeviceProp properties{};
    if (cudaGetDeviceProperties(&properties, ordinal) != cudaSuccess) continue;
    const bool too_old = properties.major < kOldestMajor ||
                         (properties.major == kOldestMajor && properties.minor < kOldestMinor);
    if (!too_old) all.push_back({ordinal, describe_device(properties, driver, runtime)});
  }
  cudaGetLastError();
  return all;
}

}  // namespace

std::vector<DeviceInfo> list_devices() {
  std::vector<DeviceInfo> infos;
  for (Entry& entry : entries()) infos.push_back(std::move(entry.info));
  return infos;
}

std::unique_ptr<Device> open_device(std::size_t index) {
  std::vector<Entry> all = entries();
  if (index >= all.size()) fail(ErrorKind::device, "there is no CUDA device {}", index);
  return std::make_unique<CudaDevice>(all[index].ordinal, all[index].info);
}

}  // namespace ubs::cuda
