// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/platform.hpp"

#include <string>

#include "host/opencl/cl_api.hpp"
#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {
namespace {

template <typename T>
T device_value(cl_device_id device, cl_device_info what) {
  T value{};
  check(clGetDeviceInfo(device, what, sizeof value, &value, nullptr), "clGetDeviceInfo");
  return value;
}

std::string device_text(cl_device_id device, cl_device_info what) {
  std::size_t bytes = 0;
  check(clGetDeviceInfo(device, what, 0, nullptr, &bytes), "clGetDeviceInfo");
  std::string text(bytes, '\0');
  check(clGetDeviceInfo(device, what, bytes, text.data(), nullptr), "clGetDeviceInfo");
  return text.c_str();
}

DeviceInfo describe_device(const std::string& platform, cl_device_id device) {
  DeviceInfo info;
  info.backend = "opencl";
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
  info.max_allocation_bytes = device_value<cl_ulong>(device, CL_DEVICE_MAX_MEM_ALLOC_SIZE);
  info.compute_units = device_value<cl_uint>(device, CL_DEVICE_MAX_COMPUTE_UNITS);
  info.has_double = device_value<cl_uint>(device, CL_DEVICE_PREFERRED_VECTOR_WIDTH_DOUBLE) > 0;
  if (info.type == DeviceType::cpu) {
    // PoCL reports the native width of the CPU's registers: 16 AVX-512, 8 AVX, 4 SSE and NEON.
    const auto native = device_value<cl_uint>(device, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT);
    info.float_vector_width = native >= 16 ? 16 : native >= 8 ? 8 : 4;
  }
  return info;
}

struct Entry {
  cl_platform_id platform;
  cl_device_id device;
  DeviceInfo info;
};

std::vector<Entry> entries() {
  std::vector<Entry> all;
  cl_uint platform_count = 0;
  // Without any driver the loader reports an error instead of zero platforms.
  if (clGetPlatformIDs(0, nullptr, &platform_count) != CL_SUCCESS || platform_count == 0) return all;
  std::vector<cl_platform_id> platforms(platform_count);
  check(clGetPlatformIDs(platform_count, platforms.data(), nullptr), "clGetPlatformIDs");
  for (cl_platform_id platform : platforms) {
    cl_uint device_count = 0;
    if (clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, 0, nullptr, &device_count) != CL_SUCCESS || device_count == 0)
      continue;
    std::vector<cl_device_id> devices(device_count);
    check(clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, device_count, devices.data(), nullptr), "clGetDeviceIDs");
    std::size_t bytes = 0;
    check(clGetPlatformInfo(platform, CL_PLATFORM_NAME, 0, nullptr, &bytes), "clGetPlatformInfo");
    std::string name(bytes, '\0');
    check(clGetPlatformInfo(platform, CL_PLATFORM_NAME, bytes, name.data(), nullptr), "clGetPlatformInfo");
    for (cl_device_id device : devices) all.push_back({platform, device, describe_device(name.c_str(), device)});
  }
  return all;
}

}  // namespace

std::vector<DeviceInfo> list_devices() {
  std::vector<DeviceInfo> infos;
  for (Entry& entry : entries()) infos.push_back(std::move(entry.info));
  return infos;
}

std::unique_ptr<Device> open_device(std::size_t index, unsigned float_vector_width) {
  std::vector<Entry> all = entries();
  if (index >= all.size()) fail(ErrorKind::device, "there is no OpenCL device {}", index);
  if (float_vector_width != 0) all[index].info.float_vector_width = float_vector_width;
  return std::make_unique<OpenclDevice>(all[index].platform, all[index].device, all[index].info);
}

}  // namespace ubs::opencl
