// SPDX-License-Identifier: Apache-2.0
#include <cuda_runtime_api.h>
#include <nvrtc.h>

#include <algorithm>
#include <memory>

#include "cuda_backend/compiler.hpp"
#include "cuda_backend/dynamic_library.hpp"
#include "host/base/error.hpp"

namespace ubs::cuda {
namespace {

// The NVRTC functions that this file calls. Their binary interface is the same in all versions of NVRTC since
// 11.2. Their types are taken from the header.
struct NvrtcLibrary {
  decltype(&nvrtcVersion) version = nullptr;
  decltype(&nvrtcGetErrorString) error_string = nullptr;
  decltype(&nvrtcGetNumSupportedArchs) arch_count = nullptr;
  decltype(&nvrtcGetSupportedArchs) archs = nullptr;
  decltype(&nvrtcCreateProgram) create = nullptr;
  decltype(&nvrtcDestroyProgram) destroy = nullptr;
  decltype(&nvrtcCompileProgram) compile = nullptr;
  decltype(&nvrtcGetProgramLogSize) log_size = nullptr;
  decltype(&nvrtcGetProgramLog) log = nullptr;
  decltype(&nvrtcGetCUBINSize) cubin_size = nullptr;
  decltype(&nvrtcGetCUBIN) cubin = nullptr;
  decltype(&nvrtcGetPTXSize) ptx_size = nullptr;
  decltype(&nvrtcGetPTX) ptx = nullptr;
};

NvrtcLibrary load_nvrtc() {
  int driver = 0;
  if (cudaDriverGetVersion(&driver) != cudaSuccess) driver = 0;
  void* handle = open_nvrtc(toolkit_names("libnvrtc", "11.2", driver), driver);
  NvrtcLibrary library;
  const auto find = [handle](const char* name, auto& function) {
    find_function(handle, "NVRTC (11.2 or newer is needed)", name, function);
  };
  find("nvrtcVersion", library.version);
  find("nvrtcGetErrorString", library.error_string);
  find("nvrtcGetNumSupportedArchs", library.arch_count);
  find("nvrtcGetSupportedArchs", library.archs);
  find("nvrtcCreateProgram", library.create);
  find("nvrtcDestroyProgram", library.destroy);
  find("nvrtcCompileProgram", library.compile);
  find("nvrtcGetProgramLogSize", library.log_size);
  find("nvrtcGetProgramLog", library.log);
  find("nvrtcGetCUBINSize", library.cubin_size);
  find("nvrtcGetCUBIN", library.cubin);
  find("nvrtcGetPTXSize", library.ptx_size);
  find("nvrtcGetPTX", library.ptx);
  return library;
}

const NvrtcLibrary& nvrtc() {
  static const NvrtcLibrary library = load_nvrtc();
  return library;
}

void check_nvrtc(nvrtcResult code, const char* call) {
  if (code != NVRTC_SUCCESS) fail(ErrorKind::device, "{} failed with {}", call, nvrtc().error_string(code));
}

struct DestroyProgram {
  void operator()(nvrtcProgram program) const { nvrtc().destroy(&program); }
};
using ProgramHandle = std::unique_ptr<std::remove_pointer_t<nvrtcProgram>, DestroyProgram>;

ProgramHandle create(const ProgramText& text) {
  std::vector<const char*> headers, names;
  for (const SourceText& header : text.headers) {
    headers.push_back(header.text.c_str());
    names.push_back(header.name.c_str());
  }
  headers.push_back("");  // an empty math.h, because dialect.h includes it, but its functions are built in
  names.push_back("math.h");
  nvrtcProgram program = nullptr;
  check_nvrtc(nvrtc().create(&program, text.main.text.c_str(), text.main.name.c_str(),
                             static_cast<int>(headers.size()), headers.data(), names.data()),
              "nvrtcCreateProgram");
  return ProgramHandle(program);
}

using Size = nvrtcResult (*)(nvrtcProgram, size_t*);
using Get = nvrtcResult (*)(nvrtcProgram, char*);
std::string take(nvrtcProgram program, Size size, Get get) {
  std::size_t bytes = 0;
  check_nvrtc(size(program, &bytes), "reading the size of a result of NVRTC");
  std::string text(bytes, '\0');
  check_nvrtc(get(program, text.data()), "reading a result of NVRTC");
  return text;
}

// Returns the newest capability that this NVRTC knows and the device can run.
int known_capability(int capability) {
  int count = 0;
  check_nvrtc(nvrtc().arch_count(&count), "nvrtcGetNumSupportedArchs");
  std::vector<int> known(static_cast<std::size_t>(count));
  check_nvrtc(nvrtc().archs(known.data()), "nvrtcGetSupportedArchs");
  std::erase_if(known, [&](int arch) { return arch > capability; });
  if (known.empty())
    fail(ErrorKind::device, "{} cannot compile for sm_{}: install another version, or use --device opencl",
         compiler_version(), capability);
  return *std::ranges::max_element(known);
}

}  // namespace

void* open_nvrtc(std::span<const std::string> names, int driver) {
  std::string newer;
  for (const std::string& name : names) {
    void* handle = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!handle) continue;
    decltype(&nvrtcVersion) version = nullptr;
    find_function(handle, "NVRTC", "nvrtcVersion", version);
    int major = 0, minor = 0;
    if (version(&major, &minor) == NVRTC_SUCCESS && (driver == 0 || major <= driver / 1000)) return handle;
    newer = fmt::format(
        " ({} has version {}.{}, whose code is too new for the driver, which supports CUDA {}.{})", name,
        major, minor, driver / 1000, driver % 1000 / 10);
    dlclose(handle);
  }
  fail(ErrorKind::device,
       "the kernels of this variant are compiled at run time, but no libnvrtc.so (CUDA toolkit) that the "
       "driver supports was found{}: add its folder to LD_LIBRARY_PATH, run 'pip install nvidia-cuda-nvrtc', "
       "or use --device opencl",
       newer);
}

std::string compiler_version() {
  int major = 0, minor = 0;
  check_nvrtc(nvrtc().version(&major, &minor), "nvrtcVersion");
  return fmt::format("NVRTC {}.{}", major, minor);
}

CompiledProgram compile_program(const ProgramSpec& spec, int capability) {
  const ProgramHandle program = create(program_text(spec));
  const int known = known_capability(capability);
  const bool machine_code = known == capability;
  Options options = spec.options;
  options.push_back(fmt::format("--gpu-architecture={}_{}", machine_code ? "sm" : "compute", known));
  options.push_back("--std=c++17");
  // Warning 550 is "set but never used". It occurs for gradients that UBS_NO_V_SHAPE does not use.
  options.push_back("--diag-suppress=550");
  if (machine_code) options.push_back("--ptxas-options=-v");
  std::vector<const char*> texts;
  for (const std::string& option : options) texts.push_back(option.c_str());
  const nvrtcResult code = nvrtc().compile(program.get(), static_cast<int>(texts.size()), texts.data());
  CompiledProgram compiled;
  compiled.log = take(program.get(), nvrtc().log_size, nvrtc().log).c_str();
  if (code != NVRTC_SUCCESS)
    fail(ErrorKind::build, "{} does not compile for sm_{} with {} ({}; options {}):\n{}", spec.file,
         capability, compiler_version(), nvrtc().error_string(code), fmt::join(options, " "), compiled.log);
  compiled.binary = machine_code ? take(program.get(), nvrtc().cubin_size, nvrtc().cubin)
                                 : take(program.get(), nvrtc().ptx_size, nvrtc().ptx);
  return compiled;
}

}  // namespace ubs::cuda
