// SPDX-License-Identifier: Apache-2.0
// Compiles device programs at run time with NVRTC, the compiler library of the CUDA toolkit (nvrtc.cpp). The
// library is opened when the first program is compiled. Compiling does not need a GPU.
#pragma once

#include <span>
#include <string>

#include "cuda_backend/program.hpp"

namespace ubs::cuda {

struct CompiledProgram {
  std::string binary;  // machine code of the GPU, or PTX if this version of NVRTC is older than the GPU
  std::string log;     // warnings, and the numbers of registers and spills of each kernel
};

// Opens the named libraries in turn until one of them is an NVRTC whose major version is not newer than the
// CUDA version of the driver, and returns its handle. `names` and `driver` are described at toolkit_names()
// in dynamic_library.hpp. If there is no such library, throws Error(device) with a message that says which
// version was found, if any, and what to install.
void* open_nvrtc(std::span<const std::string> names, int driver);
// Returns the name and version of the compiler. If there is no NVRTC, throws Error(device) with a message
// that says what to install.
std::string compiler_version();
// Compiles a program for a GPU; `capability` is 90 for sm_90. Throws Error(build) with the compiler's log if
// the program does not compile.
CompiledProgram compile_program(const ProgramSpec& spec, int capability);

// Returns the binary of a program, from a cache file if possible. The cache folder is $UBS_KERNEL_CACHE if it
// is set, otherwise $XDG_CACHE_HOME/ubs or ~/.cache/ubs; with UBS_KERNEL_CACHE=off there is no cache. The
// name of the file depends on everything that the binary depends on: source text, options, capability and
// compiler. Cache files may be deleted at any time. If a file is damaged, the program is compiled again.
std::string cached_binary(const ProgramSpec& spec, int capability);

}  // namespace ubs::cuda
