// SPDX-License-Identifier: Apache-2.0
// In place of NVRTC and the driver: a program for run time becomes a shared library of the C++ compiler that
// this build uses. It gets exactly the texts that NVRTC would get, so that one which is not embedded is
// missed here too.
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

// From the arguments of a launch to a call: `call_<kernel>` of each kernel.
std::string call_functions(const ProgramSpec& spec) {
  std::string text =
      "template <typename... P> static void ubs_call(void (*kernel)(P...), void** a) {\n"
      "  [&]<std::size_t... i>(std::index_sequence<i...>) { kernel(*static_cast<P*>(a[i])...); }\n"
      "  (std::index_sequence_for<P...>{});\n}\n";
  for (const std::string& kernel : spec.kernels)
    text += fmt::format("extern \"C\" void call_{0}(void** a) {{ ubs_call(ubs::cuda::{0}, a); }}\n", kernel);
  return text;
}

using CallFunction = void (*)(void**);

}  // namespace

std::string compiler_version() { return UBS_HOST_COMPILER " " __VERSION__; }

CompiledProgram compile_program(const ProgramSpec& spec, int) {
  const test::TempFolder folder;
  const ProgramText program = program_text(spec);
  for (const SourceText& header : program.headers) test::put(folder / header.name, header.text);
  test::put(folder / "main.cpp", "#include <cuda_runtime.h>\n" + program.main.text + call_functions(spec));
  std::string macros;
  for (const std::string& option : spec.options)
    if (option.starts_with("-D")) macros += fmt::format(" '{}'", option);
  const std::string command = fmt::format(
      "{0} -x c++ -std=c++20 -O1 -ffp-contract=off -w -fPIC -shared -Wl,-Bsymbolic -I{1} -I{2}{3} "
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
  handle_ = dlopen((folder / "p.so").c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle_) fail(ErrorKind::device, "dlopen: {}", dlerror());
}

Module::~Module() { dlclose(handle_); }

void* Module::function(const char* name) const {
  void* found = dlsym(handle_, fmt::format("call_{}", name).c_str());
  if (!found) fail(ErrorKind::device, "the program has no kernel '{}'", name);
  return found;
}

cudaError_t launch_function(void* function, dim3 grid, dim3 block, void** arguments, cudaStream_t) {
  cuda_on_host::run(grid, block, [&] { reinterpret_cast<CallFunction>(function)(arguments); });
  return cudaSuccess;
}

}  // namespace ubs::cuda
