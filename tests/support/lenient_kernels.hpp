// SPDX-License-Identifier: Apache-2.0
// While it lives, kernels are read from a copy that draws splats of any finite parameters. The product culls
// those beyond UBS_RAW_MAX, whose gradients are not finite (kernels/limits.h); what it does about such
// gradients, whatever their origin, is tested with this. Devices must be opened after it.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "host/base/file.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::test {

class LenientKernels {
 public:
  LenientKernels() {
    const std::filesystem::path copy = folder_.path() / "kernels", file = copy / "map/project.cl";
    std::filesystem::copy(std::filesystem::path(UBS_SOURCE_DIR) / "kernels", copy,
                          std::filesystem::copy_options::recursive);
    const std::string limit = "even + odd <= (vreal)(UBS_RAW_MAX * UBS_RAW_MAX)";
    std::string text = read_text_file(file);
    const std::size_t at = text.find(limit);
    if (at == std::string::npos)
      throw std::logic_error("project.cl has no limit of raw parameters: " + limit);
    std::ofstream(file, std::ios::trunc) << text.replace(at, limit.size(), "even == even");
    ::setenv("UBS_KERNEL_DIR", copy.c_str(), 1);
  }
  ~LenientKernels() { ::unsetenv("UBS_KERNEL_DIR"); }
  LenientKernels(const LenientKernels&) = delete;
  LenientKernels& operator=(const LenientKernels&) = delete;

 private:
  TempFolder folder_;
};

}  // namespace ubs::test
