// SPDX-License-Identifier: Apache-2.0
// Loads modules with the driver API, because the runtime API has functions for this only since CUDA 12.8. The
// driver library is not linked, but opened at the first use. If a device exists, the CUDA runtime has already
// opened the library.
#include "cuda_backend/module.hpp"

#include <cuda.h>

#include "cuda_backend/dynamic_library.hpp"
#include "host/base/error.hpp"

namespace ubs::cuda {
namespace {

struct Driver {
  decltype(&cuModuleLoadData) load = nullptr;
  decltype(&cuModuleUnload) unload = nullptr;
  decltype(&cuModuleGetFunction) get_function = nullptr;
  decltype(&cuLaunchKernel) launch = nullptr;
  decltype(&cuGetErrorName) error_name = nullptr;
};

Driver open_driver() {
  void* library = dlopen("libcuda.so.1", RTLD_NOW | RTLD_LOCAL);
  if (!library) fail(ErrorKind::device, "the NVIDIA driver (libcuda.so.1) cannot be opened: {}", dlerror());
  Driver driver;
  const auto find = [library](const char* name, auto& function) {
    find_function(library, "the NVIDIA driver", name, function);
  };
  find("cuModuleLoadData", driver.load);
  find("cuModuleUnload", driver.unload);
  find("cuModuleGetFunction", driver.get_function);
  find("cuLaunchKernel", driver.launch);
  find("cuGetErrorName", driver.error_name);
  return driver;
}

const Driver& driver() {
  static const Driver functions = open_driver();
  return functions;
}

void check_driver(CUresult code, const std::string& call) {
  if (code == CUDA_SUCCESS) return;
  const char* name = nullptr;
  driver().error_name(code, &name);
  fail(ErrorKind::device, "{} failed with {}", call, name ? name : std::to_string(static_cast<int>(code)));
}

}  // namespace

Module::Module(const std::string& binary) {
  CUmodule module = nullptr;
  check_driver(driver().load(&module, binary.data()), "cuModuleLoadData");
  handle_ = module;
}

Module::~Module() { driver().unload(static_cast<CUmodule>(handle_)); }

void* Module::function(const char* name) const {
  CUfunction found = nullptr;
  check_driver(driver().get_function(&found, static_cast<CUmodule>(handle_), name),
               fmt::format("cuModuleGetFunction of '{}'", name));
  return found;
}

// Since CUDA 10.1 the error codes of the driver have the same numbers as those of the runtime.
cudaError_t launch_function(void* function, dim3 grid, dim3 block, void** arguments, cudaStream_t stream) {
  return static_cast<cudaError_t>(driver().launch(static_cast<CUfunction>(function), grid.x, grid.y, grid.z,
                                                  block.x, block.y, block.z, 0, stream, arguments, nullptr));
}

}  // namespace ubs::cuda
