// SPDX-License-Identifier: Apache-2.0
// Replaces NVRTC and the driver. The C++ compiler of this build compiles a run-time program to a shared
// library. The compiler gets exactly the texts that NVRTC would get, so the tests also fail if a text has not
// been embedded in the executable.
#include <dlfcn.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <cstdlib>

#include "cuda_backend/compiler.hpp"
#include "cuda_backend/module.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::cuda {
namespace {

// Returns the source of a function `bind_<kernel>` for each kernel. This function copies the arguments of a
// launch and returns a call of the kernel that can be made later.
std::string bind_functions(const ProgramSpec& spec) {
  std::string text;
  for (const std::string& kernel : spec.kernels)
    text += fmt::format(
        "extern \"C\" void bind_{0}(void** a, std::function<void()>* call) {{ *call = "
        "ubs_bind(ubs::cuda::{0}, a); }}\n",
        kernel);
  return text;
}

using BindFunction = void (*)(void**, std::function<void()>*);

// Makes the functions of this code visible to the compiled programs. This is necessary if this code is part
// of a shared library whose symbols are not shared with other libraries, for example because Python has
// loaded it.
void show_own_symbols() {
  Dl_info info{};
  if (dladdr(reinterpret_cast<void*>(&compiler_version), &info) != 0)
    dlopen(info.dli_fname, RTLD_NOW | RTLD_GLOBAL | RTLD_NOLOAD);
}

}  // namespace

// The version is part of the key of stored programs. It also names the options and the calling convention, so
// that programs that were compiled in another way are not used.
std::string compiler_version() { return UBS_HOST_COMPILER " " __VERSION__ " -Og, bind"; }

// -Og compiles in half the time of -O1, and the resulting code is about as fast for these short runs.
CompiledProgram compile_program(const ProgramSpec& spec, int) {
  const test::TempFolder folder;
  const ProgramText program = program_text(spec);
  for (const SourceText& header : program.headers) test::put(folder / header.name, header.text);
  test::put(folder / "main.cpp", "#include <cuda_runtime.h>\n" + program.main.text + bind_functions(spec));
  std::string macros;
  for (const std::string& option : spec.options)
    if (option.starts_with("-D")) macros += fmt::format(" '{}'", option);
  const std::string command = fmt::format(
      "{0} -x c++ -std=c++20 -Og -ffp-contract=off -w -fPIC -shared -Wl,-Bsymbolic -I{1} -I{2}{3} "
      "{2}/main.cpp -o {2}/p.so "
      "> {2}/log 2>&1",
      UBS_HOST_COMPILER, UBS_CUDA_ON_HOST_INCLUDE, folder.path().string(), macros);
  if (std::system(command.c_str()) != 0)
    fail(ErrorKind::build, "{} does not compile with options {}:\n{}", spec.file,
         fmt::join(spec.options, " "), test::get(folder / "log"));
  return {test::get(folder / "p.so"), ""};
}

Module::Module(const std::string& binary) {
  const test::TempFolder folder;
  test::put(folder / "p.so", binary);
  show_own_symbols();
  handle_ = dlopen((folder / "p.so").c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle_) fail(ErrorKind::device, "the compiled program cannot be loaded: {}", dlerror());
}

Module::~Module() { dlclose(handle_); }

void* Module::function(const char* name) const {
  void* found = dlsym(handle_, fmt::format("bind_{}", name).c_str());
  if (!found) fail(ErrorKind::device, "the program has no kernel '{}'", name);
  return found;
}

cudaError_t launch_function(void* function, dim3 grid, dim3 block, void** arguments, cudaStream_t stream) {
  std::function<void()> call;
  reinterpret_cast<BindFunction>(function)(arguments, &call);
  return cuda_on_host::enqueue(stream, [grid, block, call] { cuda_on_host::run(grid, block, call); });
}

}  // namespace ubs::cuda
