// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/program.hpp"

#include <algorithm>
#include <sstream>

#include "host/device/kernel_sources.hpp"

namespace ubs::cuda {
namespace {

constexpr std::string_view kKernels = "kernels/";

// Returns the name in quotes of an #include line, or an empty string for any other line.
std::string included_name(const std::string& line) {
  constexpr std::string_view kInclude = "#include \"";
  if (!line.starts_with(kInclude)) return {};
  return line.substr(kInclude.size(), line.find('"', kInclude.size()) - kInclude.size());
}

// Adds all files that `text` includes, directly or indirectly, regardless of any #if around an #include line.
// Files that the compiler then skips do no harm.
void add_headers(const std::string& text, std::vector<SourceText>& headers) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::string name = included_name(line);
    if (name.empty() || std::ranges::count(headers, name, &SourceText::name) > 0) continue;
    std::string source = kernel_source(name.starts_with(kKernels) ? name.substr(kKernels.size()) : name);
    headers.push_back({name, source});
    add_headers(source, headers);
  }
}

}  // namespace

ProgramText program_text(const ProgramSpec& spec) {
  ProgramText program;
  program.main.name = "main of " + spec.file;
  program.main.text =
      "#define UBS_VW 1\n#define UBS_KERNEL extern \"C\" __global__\n"
      "namespace ubs { namespace cuda {\n"
      "typedef unsigned int u32; typedef unsigned long u64;\n"
      "#include \"cuda_backend/shared_math.cuh\"\n#include \"" +
      spec.file + "\"\n}}\n";
  add_headers(program.main.text, program.headers);
  return program;
}

}  // namespace ubs::cuda
