// SPDX-License-Identifier: Apache-2.0
// Replaces functions of the OpenCL library that write to buffers, to avoid an error of Oclgrind 21.10. With
// its option --uninitialized, Oclgrind records for every byte whether it has been written. But it assumes
// that a write, fill or copy by the host covers the whole buffer: it stores this record only for the
// transferred bytes, and reads out of bounds after them. Under Oclgrind, the functions of this file therefore
// write a complete temporary buffer, and a kernel copies the data to their destination, because stores of
// kernels are recorded correctly. On other platforms they call the original functions.
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <dlfcn.h>

#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

namespace {

template <typename Function>
Function next(const char* name, Function) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

bool on_oclgrind() {
  static const bool answer = [] {
    cl_platform_id platform = nullptr;
    char name[64] = {};
    return clGetPlatformIDs(1, &platform, nullptr) == CL_SUCCESS &&
           clGetPlatformInfo(platform, CL_PLATFORM_NAME, sizeof name, name, nullptr) == CL_SUCCESS &&
           std::string(name) == "Oclgrind";
  }();
  return answer;
}

cl_context context_of(cl_command_queue queue) {
  cl_context context = nullptr;
  clGetCommandQueueInfo(queue, CL_QUEUE_CONTEXT, sizeof context, &context, nullptr);
  return context;
}

// Returns the kernel that copies data. It is compiled again if the context has changed.
cl_kernel copy_kernel(cl_context context) {
  static cl_context built_for = nullptr;
  static cl_kernel kernel = nullptr;
  if (built_for == context) return kernel;
  const char* text =
      "__kernel void bring(__global const uchar* from, ulong first, __global uchar* to, ulong at, ulong "
      "bytes) {\n"
      "  for (ulong i = get_global_id(0); i < bytes; i += get_global_size(0)) to[at + i] = from[first + i];\n"
      "}\n";
  cl_program program = clCreateProgramWithSource(context, 1, &text, nullptr, nullptr);
  clBuildProgram(program, 0, nullptr, "", nullptr, nullptr);
  kernel = clCreateKernel(program, "bring", nullptr);
  built_for = context;
  return kernel;
}

// Copies bytes between two buffers with the kernel.
cl_int bring(cl_command_queue queue, cl_mem from, cl_ulong first, cl_mem to, cl_ulong at, cl_ulong bytes,
             cl_uint waits, const cl_event* wait, cl_event* event) {
  cl_kernel kernel = copy_kernel(context_of(queue));
  clSetKernelArg(kernel, 0, sizeof from, &from);
  clSetKernelArg(kernel, 1, sizeof first, &first);
  clSetKernelArg(kernel, 2, sizeof to, &to);
  clSetKernelArg(kernel, 3, sizeof at, &at);
  clSetKernelArg(kernel, 4, sizeof bytes, &bytes);
  const std::size_t items = 16;
  const cl_int code = clEnqueueNDRangeKernel(queue, kernel, 1, nullptr, &items, &items, waits, wait, event);
  return code != CL_SUCCESS ? code : clFinish(queue);
}

// Writes data of the host to a part of a buffer, through a temporary buffer.
cl_int write(cl_command_queue queue, cl_mem to, std::size_t at, std::size_t bytes, const void* data,
             cl_uint waits, const cl_event* wait, cl_event* event) {
  cl_int code = CL_SUCCESS;
  cl_mem own = clCreateBuffer(context_of(queue), CL_MEM_READ_WRITE, bytes, nullptr, &code);
  if (code != CL_SUCCESS) return code;
  const auto plain = next("clEnqueueWriteBuffer", &clEnqueueWriteBuffer);
  code = plain(queue, own, CL_TRUE, 0, bytes, data, 0, nullptr, nullptr);
  return code != CL_SUCCESS ? code : bring(queue, own, 0, to, at, bytes, waits, wait, event);
}

}  // namespace

extern "C" {

// Does not release buffers under Oclgrind.
cl_int clReleaseMemObject(cl_mem memory) {
  return on_oclgrind() ? CL_SUCCESS : next("clReleaseMemObject", &clReleaseMemObject)(memory);
}

cl_int clEnqueueWriteBuffer(cl_command_queue queue, cl_mem to, cl_bool blocking, std::size_t at,
                            std::size_t bytes, const void* data, cl_uint waits, const cl_event* wait,
                            cl_event* event) {
  if (on_oclgrind()) return write(queue, to, at, bytes, data, waits, wait, event);
  return next("clEnqueueWriteBuffer", &clEnqueueWriteBuffer)(queue, to, blocking, at, bytes, data, waits,
                                                             wait, event);
}

cl_int clEnqueueFillBuffer(cl_command_queue queue, cl_mem to, const void* pattern, std::size_t pattern_bytes,
                           std::size_t at, std::size_t bytes, cl_uint waits, const cl_event* wait,
                           cl_event* event) {
  if (!on_oclgrind())
    return next("clEnqueueFillBuffer", &clEnqueueFillBuffer)(queue, to, pattern, pattern_bytes, at, bytes,
                                                             waits, wait, event);
  std::vector<char> data(bytes);
  for (std::size_t i = 0; i + pattern_bytes <= bytes; i += pattern_bytes)
    std::memcpy(data.data() + i, pattern, pattern_bytes);
  return write(queue, to, at, bytes, data.data(), waits, wait, event);
}

cl_int clEnqueueCopyBuffer(cl_command_queue queue, cl_mem from, cl_mem to, std::size_t first, std::size_t at,
                           std::size_t bytes, cl_uint waits, const cl_event* wait, cl_event* event) {
  if (on_oclgrind()) return bring(queue, from, first, to, at, bytes, waits, wait, event);
  return next("clEnqueueCopyBuffer", &clEnqueueCopyBuffer)(queue, from, to, first, at, bytes, waits, wait,
                                                           event);
}
}
