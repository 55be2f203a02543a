// SPDX-License-Identifier: Apache-2.0
// This header includes the OpenCL C API in the version that ubs targets. It also declares handles that own
// OpenCL objects, and error checks that report the failed call. ubs requires OpenCL 1.2 and uses newer
// functions only if the device supports them.
#pragma once

#define CL_TARGET_OPENCL_VERSION 120
#ifdef __APPLE__
#include <OpenCL/cl.h>
#else
#include <CL/cl.h>
#endif

#include <memory>
#include <string>
#include <string_view>
#include <type_traits>

#include "host/base/error.hpp"

namespace ubs::opencl {

// Returns the name of an error code, such as "CL_OUT_OF_RESOURCES" for -5.
std::string error_name(cl_int code);

// Throws Error(memory) or Error(device) with the name of the call if `code` is not CL_SUCCESS. It must not be
// used in destructors.
void check(cl_int code, const char* call);

// Returns a string from clGetDeviceInfo(). If the call fails, throws the error of check().
std::string device_text(cl_device_id device, cl_device_info what);
// Returns whether `names`, a list of names that are separated by blanks, contains `name`.
bool has_word(std::string_view names, std::string_view name);

// Handle owns an OpenCL object and releases it in the destructor.
template <typename T, cl_int (*release)(T)>
struct Releaser {
  void operator()(T handle) const { release(handle); }
};
template <typename T, cl_int (*release)(T)>
using Handle = std::unique_ptr<std::remove_pointer_t<T>, Releaser<T, release>>;

using ContextHandle = Handle<cl_context, clReleaseContext>;
using QueueHandle = Handle<cl_command_queue, clReleaseCommandQueue>;
using ProgramHandle = Handle<cl_program, clReleaseProgram>;
using KernelHandle = Handle<cl_kernel, clReleaseKernel>;
using MemHandle = Handle<cl_mem, clReleaseMemObject>;
using EventHandle = Handle<cl_event, clReleaseEvent>;

}  // namespace ubs::opencl
