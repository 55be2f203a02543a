// SPDX-License-Identifier: Apache-2.0
// Device code that is compiled at run time for a specialisation: which file, macros and kernels, and the text
// that a compiler gets. The kernels are `extern "C"`, so that they are found by their names.
#pragma once

#include <string>
#include <vector>

#include "host/device/kernel_options.hpp"

namespace ubs::cuda {

struct ProgramSpec {
  std::string file;                  // "cuda_backend/raster_program.cuh", behind cuda_backend/shared_math.cuh
  std::vector<std::string> kernels;  // those in it
  Options options;                   // "-DNAME=VALUE", and flags of NVRTC
};

struct SourceText {
  std::string name, text;
};
struct ProgramText {
  SourceText main;
  std::vector<SourceText> headers;  // all that is included, by the names it is included by
};
ProgramText program_text(const ProgramSpec& spec);

}  // namespace ubs::cuda
