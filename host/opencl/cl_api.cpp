// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/cl_api.hpp"

#include <array>
#include <utility>

namespace ubs::opencl {

std::string error_name(cl_int code) {
#define UBS_CL_NAME(name) \
  std::pair<cl_int, const char*> { name, #name }
  static constexpr auto kNames = std::to_array<std::pair<cl_int, const char*>>({
      UBS_CL_NAME(CL_DEVICE_NOT_FOUND),
      UBS_CL_NAME(CL_DEVICE_NOT_AVAILABLE),
      UBS_CL_NAME(CL_COMPILER_NOT_AVAILABLE),
      UBS_CL_NAME(CL_MEM_OBJECT_ALLOCATION_FAILURE),
      UBS_CL_NAME(CL_OUT_OF_RESOURCES),
      UBS_CL_NAME(CL_OUT_OF_HOST_MEMORY),
      UBS_CL_NAME(CL_BUILD_PROGRAM_FAILURE),
      UBS_CL_NAME(CL_MAP_FAILURE),
      UBS_CL_NAME(CL_INVALID_VALUE),
      UBS_CL_NAME(CL_INVALID_DEVICE),
      UBS_CL_NAME(CL_INVALID_CONTEXT),
      UBS_CL_NAME(CL_INVALID_QUEUE_PROPERTIES),
      UBS_CL_NAME(CL_INVALID_COMMAND_QUEUE),
      UBS_CL_NAME(CL_INVALID_MEM_OBJECT),
      UBS_CL_NAME(CL_INVALID_BINARY),
      UBS_CL_NAME(CL_INVALID_BUILD_OPTIONS),
      UBS_CL_NAME(CL_INVALID_PROGRAM),
      UBS_CL_NAME(CL_INVALID_PROGRAM_EXECUTABLE),
      UBS_CL_NAME(CL_INVALID_KERNEL_NAME),
      UBS_CL_NAME(CL_INVALID_KERNEL),
      UBS_CL_NAME(CL_INVALID_ARG_INDEX),
      UBS_CL_NAME(CL_INVALID_ARG_VALUE),
      UBS_CL_NAME(CL_INVALID_ARG_SIZE),
      UBS_CL_NAME(CL_INVALID_KERNEL_ARGS),
      UBS_CL_NAME(CL_INVALID_WORK_DIMENSION),
      UBS_CL_NAME(CL_INVALID_WORK_GROUP_SIZE),
      UBS_CL_NAME(CL_INVALID_WORK_ITEM_SIZE),
      UBS_CL_NAME(CL_INVALID_GLOBAL_OFFSET),
      UBS_CL_NAME(CL_INVALID_EVENT_WAIT_LIST),
      UBS_CL_NAME(CL_INVALID_EVENT),
      UBS_CL_NAME(CL_INVALID_OPERATION),
      UBS_CL_NAME(CL_INVALID_BUFFER_SIZE),
      UBS_CL_NAME(CL_INVALID_GLOBAL_WORK_SIZE),
      UBS_CL_NAME(CL_INVALID_PLATFORM),
  });
#undef UBS_CL_NAME
  for (const auto& [value, name] : kNames)
    if (value == code) return name;
  return "OpenCL error " + std::to_string(code);
}

void check(cl_int code, const char* call) {
  if (code == CL_SUCCESS) return;
  const bool memory = code == CL_MEM_OBJECT_ALLOCATION_FAILURE || code == CL_OUT_OF_HOST_MEMORY;
  fail(memory ? ErrorKind::memory : ErrorKind::device, "{} failed with {}", call, error_name(code));
}

std::string device_text(cl_device_id device, cl_device_info what) {
  std::size_t bytes = 0;
  check(clGetDeviceInfo(device, what, 0, nullptr, &bytes), "clGetDeviceInfo");
  std::string text(bytes, '\0');
  check(clGetDeviceInfo(device, what, bytes, text.data(), nullptr), "clGetDeviceInfo");
  return text.c_str();
}

bool has_word(std::string_view names, std::string_view name) {
  for (std::size_t at = names.find(name); at != names.npos; at = names.find(name, at + 1)) {
    const std::size_t end = at + name.size();
    if ((at == 0 || names[at - 1] == ' ') && (end == names.size() || names[end] == ' ')) return true;
  }
  return false;
}

}  // namespace ubs::opencl
