// SPDX-License-Identifier: Apache-2.0
// The compiler of programs at run time: NVRTC (nvrtc.cpp), which is looked for when the first program is
// wanted. It needs no GPU.
#pragma once

#include <span>
#include <string>

#include "cuda_backend/program.hpp"

namespace ubs::cuda {

struct CompiledProgram {
  std::string binary;  // machine code, or PTX for a capability that this NVRTC does not know yet
  std::string log;     // registers and spills of each kernel, warnings
};

// The first library of the names that is an NVRTC no newer than the driver (toolkit_names() in
// dynamic_library.hpp). Throws Error(device) saying what is there and what to install.
void* open_nvrtc(std::span<const std::string> names, int driver);
// Name and version. Throws Error(device) saying what to install when there is no NVRTC.
std::string compiler_version();
// capability: 90 for sm_90. Throws Error(build) with the compiler's log.
CompiledProgram compile_program(const ProgramSpec& spec, int capability);

// The binary alone, kept in $UBS_KERNEL_CACHE, else $XDG_CACHE_HOME/ubs, else ~/.cache/ubs ("off": nowhere),
// in a file named by all that it depends on: text, options, capability, compiler. A file may be deleted at
// any time; one that is damaged is made again.
std::string cached_binary(const ProgramSpec& spec, int capability);

}  // namespace ubs::cuda
