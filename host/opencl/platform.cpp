// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/platform.hpp"

#include <algorithm>
#include <cstring>
#include <string>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/base/warning.hpp"
#include "host/opencl/cl_api.hpp"
#include "host/opencl/driver_cache.hpp"
#include "host/opencl/opencl_device.hpp"
#include "host/opencl/opencl_tuning.hpp"

namespace ubs::opencl {
namespace {

constexpr const char* kPocl = "Portable Computing Language";

template <typename T>
T device_value(cl_device_id device, cl_device_info what) {
  T value{};
  check(clGetDeviceInfo(device, what, sizeof value, &value, nullptr), "clGetDeviceInfo");
  return value;
}

// Returns the names of the optional features of OpenCL C 3.0, each surrounded by blanks. Older devices do not
// support the query.
std::string language_features(cl_device_id device) {
  constexpr cl_device_info kFeatures = 0x106F;  // CL_DEVICE_OPENCL_C_FEATURES
  struct NameVersion {                          // cl_name_version
    cl_uint version;
    char name[64];
  };
  std::size_t bytes = 0;
  if (clGetDeviceInfo(device, kFeatures, 0, nullptr, &bytes) != CL_SUCCESS) return "";
  std::vector<NameVersion> entries(bytes / sizeof(NameVersion));
  if (clGetDeviceInfo(device, kFeatures, bytes, entries.data(), nullptr) != CL_SUCCESS) return "";
  std::string names = " ";
  for (const NameVersion& entry : entries) names.append(entry.name, strnlen(entry.name, 64)).append(" ");
  return names;
}

// PciBusInfo is the result of a query of the extension cl_khr_pci_bus_info. This type and the constants below
// are declared here, because some versions of the OpenCL headers do not contain them.
struct PciBusInfo {
  cl_uint domain, bus, device, function;
};
constexpr cl_device_info kPciBusInfo = 0x410F, kPciBusNv = 0x4008, kPciSlotNv = 0x4009, kPciDomainNv = 0x400A;

std::string pci_text(const PciBusInfo& pci) {
  return fmt::format("{:04x}:{:02x}:{:02x}.{:x}", pci.domain, pci.bus, pci.device, pci.function);
}

// Returns the PCI address, such as "0000:1b:00.0", or an empty string if the driver does not report it.
std::string pci_address(cl_device_id device, const std::string& extensions) {
  const auto get = [&](cl_device_info name, auto& value) {
    return clGetDeviceInfo(device, name, sizeof value, &value, nullptr) == CL_SUCCESS;
  };
  PciBusInfo pci{};
  if (has_word(extensions, "cl_khr_pci_bus_info") && get(kPciBusInfo, pci)) return pci_text(pci);
  cl_uint slot = 0;
  if (!has_word(extensions, "cl_nv_device_attribute_query") || !get(kPciBusNv, pci.bus) ||
      !get(kPciSlotNv, slot))
    return {};
  get(kPciDomainNv, pci.domain);  // older drivers do not support this query
  pci.device = slot >> 3;
  pci.function = slot & 7;
  return pci_text(pci);
}

// GroupLimits contains the limits of a device for work-groups. The kernels for GPUs run in work-groups of 256
// work-items, and the largest kernel uses 28 KiB of local memory (gpu/raster_backward.cl). Devices with the
// full profile of OpenCL have at least 32 KiB.
struct GroupLimits {
  std::size_t items;
  std::uint64_t local_bytes;
  static constexpr std::size_t kItemsNeeded = 256;
  static constexpr std::uint64_t kLocalNeeded = 32 * 1024;
  bool too_small() const { return items < kItemsNeeded || local_bytes < kLocalNeeded; }
};
GroupLimits group_limits(cl_device_id device) {
  return {device_value<std::size_t>(device, CL_DEVICE_MAX_WORK_GROUP_SIZE),
          device_value<cl_ulong>(device, CL_DEVICE_LOCAL_MEM_SIZE)};
}

DeviceInfo describe_device(const std::string& platform, cl_device_id device) {
  DeviceInfo info;
  info.backend = "opencl";
  info.has_cpu_raster = true;
  info.platform = platform;
  info.name = device_text(device, CL_DEVICE_NAME);
  info.vendor = device_text(device, CL_DEVICE_VENDOR);
  info.driver = device_text(device, CL_DRIVER_VERSION);
  info.version = device_text(device, CL_DEVICE_VERSION);
  const auto type = device_value<cl_device_type>(device, CL_DEVICE_TYPE);
  info.type = type & CL_DEVICE_TYPE_CPU   ? DeviceType::cpu
              : type & CL_DEVICE_TYPE_GPU ? DeviceType::gpu
                                          : DeviceType::accelerator;
  info.memory_bytes = device_value<cl_ulong>(device, CL_DEVICE_GLOBAL_MEM_SIZE);
  if (info.type == DeviceType::cpu) info.memory_bytes = std::min(info.memory_bytes, memory_left());
  info.max_allocation_bytes = device_value<cl_ulong>(device, CL_DEVICE_MAX_MEM_ALLOC_SIZE);
  info.compute_units = device_value<cl_uint>(device, CL_DEVICE_MAX_COMPUTE_UNITS);
  info.has_double = device_value<cl_uint>(device, CL_DEVICE_PREFERRED_VECTOR_WIDTH_DOUBLE) > 0;
  if (info.type == DeviceType::cpu) {
    // PoCL reports the number of floats in a register of the CPU: 16 for AVX-512, 8 for AVX, 4 for SSE and
    // NEON. Drivers whose compiler vectorises across work-items by itself, such as llvmpipe, report 1. With
    // explicit vectors, the code of their kernels would be four times as long.
    const auto native = device_value<cl_uint>(device, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT);
    info.float_vector_width = native >= 16 ? 16 : native >= 8 ? 8 : native >= 2 ? 4 : 1;
  } else if (group_limits(device).too_small()) {
    info.float_vector_width = 4;  // use the kernels for CPUs, whose groups have a single work-item
  }
  const std::string extensions = device_text(device, CL_DEVICE_EXTENSIONS);
  info.pci = pci_address(device, extensions);
  info.subgroup_language = subgroup_language(info.version, extensions, language_features(device));
  info.tuning = load_tuning(info, tuned_constants());
  return info;
}

struct Entry {
  cl_platform_id platform;
  cl_device_id device;
  DeviceInfo info;
};

// Calls `add`. If it throws, prints a warning, so that a faulty driver or device does not hide the others.
template <typename Add>
void add_if_sound(const std::string& what, const Add& add) {
  try {
    add();
  } catch (const std::exception& fault) {
    warn_once(fmt::format("{} is not used: {}", what, fault.what()));
  }
}

std::string platform_name(cl_platform_id platform) {
  std::size_t bytes = 0;
  check(clGetPlatformInfo(platform, CL_PLATFORM_NAME, 0, nullptr, &bytes), "clGetPlatformInfo");
  std::string name(bytes, '\0');
  check(clGetPlatformInfo(platform, CL_PLATFORM_NAME, bytes, name.data(), nullptr), "clGetPlatformInfo");
  return name.c_str();
}

std::vector<cl_device_id> devices_of(cl_platform_id platform) {
  cl_uint count = 0;
  const cl_int code = clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, 0, nullptr, &count);
  if (code == CL_DEVICE_NOT_FOUND || (code == CL_SUCCESS && count == 0)) return {};
  check(code, "clGetDeviceIDs");
  std::vector<cl_device_id> devices(count);
  check(clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, count, devices.data(), nullptr), "clGetDeviceIDs");
  return devices;
}

void add_devices(cl_platform_id platform, const std::string& name, std::vector<Entry>& all) {
  if (name == kPocl && !driver_has_folder())
    fail(ErrorKind::data,
         "it would run compiled kernels from a folder that another user may have created: set "
         "POCL_CACHE_DIR, XDG_CACHE_HOME or HOME");
  std::size_t number = 0;
  for (cl_device_id device : devices_of(platform))
    add_if_sound(fmt::format("device {} of the OpenCL platform '{}'", number++, name), [&] {
      all.push_back({platform, device, describe_device(name, device)});
    });
}

std::vector<Entry> entries() {
  [[maybe_unused]] static const bool fits = (check_driver_fits(), true);  // before libraries are loaded
  prepare_driver_cache();
  std::vector<Entry> all;
  cl_uint count = 0;
  // If there is no driver, the loader reports an error instead of zero platforms.
  if (clGetPlatformIDs(0, nullptr, &count) != CL_SUCCESS || count == 0) return all;
  std::vector<cl_platform_id> platforms(count);
  check(clGetPlatformIDs(count, platforms.data(), nullptr), "clGetPlatformIDs");
  for (cl_uint i = 0; i < count; ++i) {
    std::string what = fmt::format("OpenCL platform {}", i);
    add_if_sound(what, [&] {
      const std::string name = platform_name(platforms[i]);
      what = fmt::format("the OpenCL platform '{}'", name);
      add_devices(platforms[i], name, all);
    });
  }
  return all;
}

}  // namespace

std::string subgroup_language(std::string_view version, std::string_view extensions,
                              std::string_view features) {
  // OpenCL 2.1 requires sub-groups, but in OpenCL 3.0 they are optional.
  if (version.starts_with("OpenCL 3.")) return has_word(features, "__opencl_c_subgroups") ? "CL3.0" : "";
  if (version.starts_with("OpenCL 2.")) return has_word(extensions, "cl_khr_subgroups") ? "CL2.0" : "";
  return "";
}

std::vector<DeviceInfo> list_devices() {
  std::vector<DeviceInfo> infos;
  for (Entry& entry : entries()) infos.push_back(std::move(entry.info));
  return infos;
}

std::unique_ptr<Device> open_device(std::size_t index, unsigned float_vector_width) {
  std::vector<Entry> all = entries();
  if (index >= all.size()) fail(ErrorKind::device, "OpenCL device {} does not exist", index);
  DeviceInfo& info = all[index].info;
  if (float_vector_width != 0) info.float_vector_width = float_vector_width;
  if (const GroupLimits limits = group_limits(all[index].device);
      info.type != DeviceType::cpu && limits.too_small())
    warn_once(
        fmt::format("{} allows work-groups of {} work-items and {} KiB of local memory, but the GPU "
                    "kernels need {} and {} KiB: the slower CPU kernels are used",
                    info.name, limits.items, limits.local_bytes >> 10, GroupLimits::kItemsNeeded,
                    GroupLimits::kLocalNeeded >> 10));
  return std::make_unique<OpenclDevice>(all[index].platform, all[index].device, info);
}

}  // namespace ubs::opencl
