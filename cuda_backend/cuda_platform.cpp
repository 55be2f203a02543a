// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/cuda_platform.hpp"

#include <fmt/ranges.h>

#include <algorithm>

#include "cuda_backend/cuda_device.hpp"
#include "host/base/warning.hpp"

namespace ubs::cuda {
namespace {

constexpr int kOldest = 75;  // sm_75, the oldest capability that CUDA 13 compiles for

std::string version_text(int version) { return fmt::format("{}.{}", version / 1000, version % 1000 / 10); }

std::string error_text(cudaError_t code) {
  cudaGetLastError();  // clears the error, so that the next call does not report it again
  return fmt::format("{}: {}", cudaGetErrorName(code), cudaGetErrorString(code));
}

int capability_of(const cudaDeviceProp& properties) { return 10 * properties.major + properties.minor; }

// Machine code runs on later GPUs with the same major version of the capability.
bool has_machine_code(int capability) {
  return std::ranges::any_of(compiled_capabilities(), [capability](int compiled) {
    return compiled / 10 == capability / 10 && compiled <= capability;
  });
}

// Returns the reason why the kernels of this build cannot run on the GPU, or an empty string if they can.
// Opens the GPU.
std::string code_defect(int ordinal, int capability) {
  cudaFuncAttributes attributes{};
  cudaError_t code = cudaSetDevice(ordinal);
  if (code == cudaSuccess)
    code = cudaFuncGetAttributes(&attributes, reinterpret_cast<const void*>(list_kernels().fit.symbol));
  if (code == cudaSuccess) return {};
  return fmt::format(
      "this build (sm_{}) has no code for this GPU ({}): configure with -DCMAKE_CUDA_ARCHITECTURES={}",
      fmt::join(compiled_capabilities(), ", sm_"), error_text(code), capability);
}

// Returns the reason why a GPU cannot be used, or an empty string if it can. If this build has machine code
// for the GPU, the GPU is not opened, because opening takes tenths of a second and hundreds of megabytes per
// GPU.
std::string defect(int ordinal, int capability) {
  if (capability < kOldest) return fmt::format("the CUDA back end requires sm_{} or newer", kOldest);
  return has_machine_code(capability) ? std::string() : code_defect(ordinal, capability);
}

DeviceInfo describe_device(const cudaDeviceProp& properties, int driver, int runtime) {
  DeviceInfo info;
  info.backend = "cuda";
  info.sorts_by_copying = true;  // because SortPairs of CUB writes its result to a second array
  info.platform = fmt::format("CUDA runtime {}", version_text(runtime));
  info.vendor = "NVIDIA";
  info.name = properties.name;
  info.driver = fmt::format("CUDA {}", version_text(driver));
  info.pci = fmt::format("{:04x}:{:02x}:{:02x}.0", properties.pciDomainID, properties.pciBusID,
                         properties.pciDeviceID);
  info.version = fmt::format("sm_{}", capability_of(properties));
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
  int ordinal, capability;
  DeviceInfo info;
};

// Returns the number of GPUs. Without a driver or without a GPU, returns 0 and prints nothing, because this
// is normal. If the GPUs cannot be counted for another reason, returns 0 and prints a warning once.
int count_cards(int driver, int runtime) {
  int count = 0;
  const cudaError_t code = cudaGetDeviceCount(&count);
  if (code == cudaSuccess) return count;
  const std::string text = error_text(code);
  const int needed = runtime / 1000 * 1000;  // a driver supports all versions with its major number
  if (driver == 0 || code == cudaErrorNoDevice) return 0;
  if (driver < needed)
    warn_once(
        fmt::format("no CUDA devices: the driver supports CUDA {}, but this build needs {}: update the "
                    "driver, or use --device opencl",
                    version_text(driver), version_text(needed)));
  else
    warn_once(fmt::format("no CUDA devices: {}", text));
  return 0;
}

std::vector<Entry> entries() {
  std::vector<Entry> all;
  int driver = 0, runtime = 0;
  if (cudaDriverGetVersion(&driver) != cudaSuccess || cudaRuntimeGetVersion(&runtime) != cudaSuccess)
    driver = 0;
  const int count = count_cards(driver, runtime);
  for (int ordinal = 0; ordinal < count; ++ordinal) {
    cudaDeviceProp properties{};
    const cudaError_t code = cudaGetDeviceProperties(&properties, ordinal);
    if (code != cudaSuccess) {
      warn_once(fmt::format("CUDA device {} is not used: {}", ordinal, error_text(code)));
      continue;
    }
    const std::string why = defect(ordinal, capability_of(properties));
    if (why.empty())
      all.push_back({ordinal, capability_of(properties), describe_device(properties, driver, runtime)});
    else
      warn_once(fmt::format("{} (CUDA device {}, sm_{}) is not used: {}", properties.name, ordinal,
                            capability_of(properties), why));
  }
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
  if (index >= all.size()) fail(ErrorKind::device, "CUDA device {} does not exist", index);
  const Entry& entry = all[index];
  if (const std::string why = code_defect(entry.ordinal, entry.capability); !why.empty())
    fail(ErrorKind::device, "{}: {}", entry.info.name, why);
  return std::make_unique<CudaDevice>(entry.ordinal, entry.info);
}

}  // namespace ubs::cuda
