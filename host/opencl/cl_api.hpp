// SPDX-License-Identifier: Apache-2.0
// The OpenCL C API with the version we target, owning handles, and error checks that name the call.
// OpenCL 1.2 is the floor; anything newer is used only after asking the device.
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

// "CL_OUT_OF_RESOURCES" for -5, and so on.
std::string error_name(cl_int code);

// Throws Error(device) naming the call. Destructors must not use it.
void check(cl_int code, const char* call);

// An answer of clGetDeviceInfo that is a text; throws Error(device).
std::string device_text(cl_device_id device, cl_device_info what);
// Whether a list of names between blanks has this one.
bool has_word(std::string_view names, std::string_view name);

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
