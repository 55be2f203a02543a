// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/kernel.hpp"

#include <dlfcn.h>

#include "host/opencl/driver_watch.hpp"
#include "host/opencl/memory.hpp"
#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

Kernel::Kernel(OpenclDevice& device, cl_program program, std::string name)
    : device_(&device), name_(std::move(name)) {
  cl_int code = CL_SUCCESS;
  kernel_.reset(clCreateKernel(program, name_.c_str(), &code));
  if (code != CL_SUCCESS)
    fail(ErrorKind::internal, "kernel '{}' is missing from its program ({})", name_, error_name(code));
  check(clGetKernelInfo(kernel_.get(), CL_KERNEL_NUM_ARGS, sizeof argument_count_, &argument_count_, nullptr),
        "clGetKernelInfo");
}

// This function is called only after a launch has failed, because the reported limits are not reliable. For
// example, for kernels that rusticl 22.3 can run in groups of 256, it reports a limit of 32 work-items and
// twice the local memory that they need.
void Kernel::check_group(std::size_t items, cl_int code) const {
  std::size_t most = items;
  cl_ulong needed = 0, available = 0;
  const auto ask = [&](cl_kernel_work_group_info what, auto& answer) {
    clGetKernelWorkGroupInfo(kernel_.get(), device_->id(), what, sizeof answer, &answer, nullptr);
  };
  ask(CL_KERNEL_WORK_GROUP_SIZE, most);
  ask(CL_KERNEL_LOCAL_MEM_SIZE, needed);
  clGetDeviceInfo(device_->id(), CL_DEVICE_LOCAL_MEM_SIZE, sizeof available, &available, nullptr);
  constexpr const char* kAdvice = "set raster = cpu, or choose another device with --device";
  if (items > most)
    fail(ErrorKind::device,
         "kernel '{}' needs work-groups of {} work-items, but {} allows at most {} for this kernel ({}): {}",
         name_, items, device_->info().name, most, error_name(code), kAdvice);
  if (needed > available)
    fail(ErrorKind::device, "kernel '{}' needs {} bytes of local memory, but {} has only {} ({}): {}", name_,
         needed, device_->info().name, available, error_name(code), kAdvice);
}

cl_mem Kernel::memory_of(Memory* memory) {
  return memory ? static_cast<OpenclMemory*>(memory)->handle() : nullptr;
}

void Kernel::check_count(std::size_t given) const {
  if (!kernel_) fail(ErrorKind::internal, "cannot launch a kernel that was not created");
  if (given != argument_count_)
    fail(ErrorKind::internal, "kernel '{}' takes {} arguments, but {} were passed", name_, argument_count_,
         given);
}

void Kernel::check_types(std::span<const ParameterType> declared) const {
  cl_uint index = 0;
  const auto check_next = [&](const ParameterType& type) {
    char text[64] = "";
    cl_kernel_arg_type_qualifier qualifier = 0;
    const cl_int code =
        clGetKernelArgInfo(kernel_.get(), index, CL_KERNEL_ARG_TYPE_NAME, sizeof text, text, nullptr);
    if (code == CL_KERNEL_ARG_INFO_NOT_AVAILABLE) return;
    clGetKernelArgInfo(kernel_.get(), index, CL_KERNEL_ARG_TYPE_QUALIFIER, sizeof qualifier, &qualifier,
                       nullptr);
    std::string compiled = text, wanted(type.name);
    std::erase_if(compiled, [](char c) { return c >= '0' && c <= '9'; });  // compare uint2* as uint*
    if (compiled.starts_with("real")) compiled.replace(0, 4, "float");
    if (type.pointer) wanted += '*';
    const bool constant = (qualifier & CL_KERNEL_ARG_TYPE_CONST) != 0;
    if (code != CL_SUCCESS || compiled != wanted || (type.pointer && constant != type.constant))
      fail(ErrorKind::internal, "kernel '{}', argument {}: '{}{}' is declared, but '{}{}' was compiled",
           name_, index, type.constant ? "const " : "", wanted, constant ? "const " : "", compiled);
    ++index;
  };
  for (const ParameterType& type : declared) {
    for (unsigned k = 0; k < type.times; ++k) check_next(type);
    if (type.times > 1) check_next({"uint", false, false});  // slot_bits
  }
  if (index > 0 && index != argument_count_ && index + 2 != argument_count_)  // core groups add two arguments
    fail(ErrorKind::internal, "kernel '{}' takes {} arguments, but {} are declared", name_, argument_count_,
         index);
}

void Kernel::set_bytes(cl_uint index, std::size_t bytes, const void* value) {
  const cl_int code = clSetKernelArg(kernel_.get(), index, bytes, value);
  if (code != CL_SUCCESS)
    fail(ErrorKind::internal, "kernel '{}': setting argument {} of {} bytes failed with {}", name_, index,
         bytes, error_name(code));
}

std::size_t Kernel::sub_group_size(Range group) const {
  // Headers for OpenCL 1.2 declare neither the function of OpenCL 2.1 nor that of cl_khr_subgroups.
  using Query = cl_int(CL_API_CALL*)(cl_kernel, cl_device_id, cl_uint, std::size_t, const void*, std::size_t,
                                     void*, std::size_t*);
  constexpr cl_uint kSizeForRange =
      0x2033;  // CL_KERNEL_MAX_SUB_GROUP_SIZE_FOR_NDRANGE, with and without _KHR
  const std::size_t sizes[3] = {group.x, group.y, group.z};
  const auto ask = [&](void* function) {
    std::size_t size = 0;
    const auto query = reinterpret_cast<Query>(function);
    const bool answered = query && query(kernel_.get(), device_->id(), kSizeForRange, sizeof sizes, sizes,
                                         sizeof size, &size, nullptr) == CL_SUCCESS;
    return answered ? size : 0;
  };
  // Do not call the function for older drivers: the loader would call it through the driver's function table,
  // which may end before this entry.
  if (device_->info().version >= "OpenCL 2.1")
    if (const std::size_t size = ask(dlsym(RTLD_DEFAULT, "clGetKernelSubGroupInfo"))) return size;
  cl_platform_id platform = nullptr;
  check(clGetDeviceInfo(device_->id(), CL_DEVICE_PLATFORM, sizeof platform, &platform, nullptr),
        "clGetDeviceInfo");
  return ask(clGetExtensionFunctionAddressForPlatform(platform, "clGetKernelSubGroupInfoKHR"));
}

void Kernel::launch(Range global, Range local) {
  if (global.x == 0 || global.y == 0 || global.z == 0) return;
  if (global.x % local.x != 0 || global.y % local.y != 0 || global.z % local.z != 0)
    fail(ErrorKind::internal, "kernel '{}': global size {}x{}x{} is not a multiple of local size {}x{}x{}",
         name_, global.x, global.y, global.z, local.x, local.y, local.z);
  const std::size_t sizes[3] = {global.x, global.y, global.z};
  const std::size_t groups[3] = {local.x, local.y, local.z};
  cl_event event = nullptr;
  const cl_int code = watched(name_, [&] {  // at the first launch, drivers compile the kernel here
    return clEnqueueNDRangeKernel(device_->queue(), kernel_.get(), 3, nullptr, sizes, groups, 0, nullptr,
                                  device_->profiling() ? &event : nullptr);
  });
  if (code == CL_INVALID_WORK_GROUP_SIZE || code == CL_INVALID_WORK_ITEM_SIZE || code == CL_OUT_OF_RESOURCES)
    check_group(local.x * local.y * local.z, code);
  if (code != CL_SUCCESS)
    fail(code == CL_MEM_OBJECT_ALLOCATION_FAILURE ? ErrorKind::memory : ErrorKind::device,
         "launch of kernel '{}' ({}x{}x{} items) failed with {}", name_, global.x, global.y, global.z,
         error_name(code));
  device_->record(name_, event);
  if (device_->synchronous()) {
    const cl_int finished = clFinish(device_->queue());
    if (finished != CL_SUCCESS)
      fail(ErrorKind::device, "kernel '{}' failed with {}", name_, error_name(finished));
  }
}

}  // namespace ubs::opencl
