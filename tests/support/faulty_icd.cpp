// SPDX-License-Identifier: Apache-2.0
// This file implements an OpenCL driver for tests, with one platform and two devices. All queries of
// properties of the devices fail. If the environment variable UBS_FAULTY_ICD is "platform", listing the
// devices also fails.
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <CL/cl_icd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

struct _cl_platform_id {
  const cl_icd_dispatch* dispatch;
};
struct _cl_device_id {
  const cl_icd_dispatch* dispatch;
};

namespace {

extern cl_icd_dispatch dispatch;
_cl_platform_id platform{&dispatch};
_cl_device_id devices[2]{{&dispatch}, {&dispatch}};

cl_int get_platforms(cl_uint most, cl_platform_id* list, cl_uint* count) {
  if (most > 0 && list) *list = &platform;
  if (count) *count = 1;
  return CL_SUCCESS;
}

cl_int platform_info(cl_platform_id, cl_platform_info what, std::size_t room, void* to, std::size_t* bytes) {
  const char* text = what == CL_PLATFORM_NAME             ? "Faulty Driver"
                     : what == CL_PLATFORM_VERSION        ? "OpenCL 1.2 faulty"
                     : what == CL_PLATFORM_ICD_SUFFIX_KHR ? "FAULTY"
                     : what == CL_PLATFORM_EXTENSIONS     ? "cl_khr_icd"
                                                          : "";
  const std::size_t length = std::strlen(text) + 1;
  if (to && room < length) return CL_INVALID_VALUE;
  if (to) std::memcpy(to, text, length);
  if (bytes) *bytes = length;
  return CL_SUCCESS;
}

cl_int get_devices(cl_platform_id, cl_device_type, cl_uint most, cl_device_id* list, cl_uint* count) {
  const char* fault = std::getenv("UBS_FAULTY_ICD");
  if (fault && std::strcmp(fault, "platform") == 0) return CL_OUT_OF_HOST_MEMORY;
  for (cl_uint i = 0; list && i < std::min<cl_uint>(most, 2); ++i) list[i] = &devices[i];
  if (count) *count = 2;
  return CL_SUCCESS;
}

cl_int device_info(cl_device_id, cl_device_info, std::size_t, void*, std::size_t*) {
  return CL_OUT_OF_RESOURCES;
}

cl_icd_dispatch make_dispatch() {
  cl_icd_dispatch table{};
  table.clGetPlatformIDs = get_platforms;
  table.clGetPlatformInfo = platform_info;
  table.clGetDeviceIDs = get_devices;
  table.clGetDeviceInfo = device_info;
  return table;
}
cl_icd_dispatch dispatch = make_dispatch();

}  // namespace

extern "C" __attribute__((visibility("default"))) void* clGetExtensionFunctionAddress(const char* name) {
  const bool asked = std::strcmp(name, "clIcdGetPlatformIDsKHR") == 0;
  return asked ? reinterpret_cast<void*>(get_platforms) : nullptr;
}
extern "C" __attribute__((visibility("default"))) cl_int clGetPlatformInfo(cl_platform_id of,
                                                                           cl_platform_info what,
                                                                           std::size_t room, void* to,
                                                                           std::size_t* bytes) {
  return platform_info(of, what, room, to, bytes);
}
