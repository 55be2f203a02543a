// SPDX-License-Identifier: Apache-2.0
// ProgramSpec describes device code that is compiled at run time for one kernel configuration: its file,
// macros and kernels. program_text() returns the text that is passed to the compiler. The kernels are
// `extern "C"`, so that they can be found by their names.
#pragma once

#include <string>
#include <vector>

#include "host/device/kernel_options.hpp"

namespace ubs::cuda {

struct ProgramSpec {
  // Path of the file, for example "cuda_backend/raster_program.cuh". The program includes shared_math.cuh
  // before this file.
  std::string file;
  std::vector<std::string> kernels;  // names of the kernels in the program
  Options options;                   // macros as "-DNAME=VALUE", and options of NVRTC
};

struct SourceText {
  std::string name, text;
};
struct ProgramText {
  SourceText main;
  std::vector<SourceText> headers;  // all included files, with the names that the #include lines use
};
ProgramText program_text(const ProgramSpec& spec);

}  // namespace ubs::cuda
