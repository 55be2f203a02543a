// SPDX-License-Identifier: Apache-2.0
// The compiler of programs at run time: NVRTC (nvrtc.cpp). The library is opened when the first program is
// compiled, and needs no GPU.
#pragma once

#include <span>
#include <string>

#include "cuda_backend/program.hpp"

namespace ubs::cuda {

struct CompiledProgram {
  std::string binary;  // machine code; PTX if this NVRTC does not know the capability yet
  std::string log;     // registers and spills of each kernel, and warnings
};

// Opens the first of the named libraries that is an NVRTC no newer than the driver (toolkit_names() in
// dynamic_library.hpp). Otherwise throws Error(device), saying what was found and what to install.
void* open_nvrtc(std::span<const std::string> names, int driver);
// Returns the name and version of the compiler. Throws Error(device), saying what to install, if there is no
// NVRTC.
std::string compiler_version();
// Compiles a program for a GPU; `capability` is 90 for sm_90. Throws Error(build) with the compiler's log if
// the program does not compile.
CompiledProgram compile_program(const ProgramSpec& spec, int capability);

// Returns the binary of a program, from a cache file if possible. The cache folder is $UBS_KERNEL_CACHE if it
// is set, otherwise $XDG_CACHE_HOME/ubs or ~/.cache/ubs; with UBS_KERNEL_CACHE=off there is no cache. The
// name of the file depends on everything that the binary depends on: source text, options, capability and
// compiler. Cache files may be deleted at any time, and a damaged file is compiled again.
std::string cached_binary(const ProgramSpec& spec, int capability);

}  // namespace ubs::cuda
