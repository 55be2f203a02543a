// SPDX-License-Identifier: Apache-2.0
// ProgramSpec describes device code that is compiled at run time for a specialisation: its file, macros and
// kernels. program_text() returns the text that the compiler gets. The kernels are `extern "C"`, so that they
// are found by their names.
#pragma once

#include <string>
#include <vector>

#include "host/device/kernel_options.hpp"

namespace ubs::cuda {

struct ProgramSpec {
  std::string file;                  // "cuda_backend/raster_program.cuh", included after shared_math.cuh
  std::vector<std::string> kernels;  // the kernels in it
  Options options;                   // "-DNAME=VALUE", and options of NVRTC
};

struct SourceText {
  std::string name, text;
};
struct ProgramText {
  SourceText main;
  std::vector<SourceText> headers;  // all included files, by the names in the #include lines
};
ProgramText program_text(const ProgramSpec& spec);

}  // namespace ubs::cuda
